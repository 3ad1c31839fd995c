#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission/images/image_file.hpp"
#include "recon/geometry/camera.hpp"

namespace fathom::topside {

// What the samples of a camera's image files are.
enum class Samples : std::uint8_t { kAuto, kMono, kRgb, kRggb, kBggr, kGrbg, kGbrg };
// By their number, as options name them.
[[nodiscard]] const std::vector<std::string>& sampleNames();
[[nodiscard]] Samples samplesNamed(const std::string& name);

// Reads TIFF, PNG, JPEG and what GDAL reads, 8 to 16 bit, as kMono, kBayerRggb or kRgb; mosaics of another
// order than RGGB are made RGB. kAuto: colours where the file has them; a grey file is a mosaic RGGB if it is
// named *_LC16, as the ACFR does, else mono. Throws InputError, which names the file.
[[nodiscard]] io::ImageFile readSamples(const std::filesystem::path& path, Samples samples);

// Of a grey image whose pixels differ by their place in squares of 2 x 2, two on a diagonal being alike, as
// in a mosaic of a scene with a colour; in water blue is taken to be the brighter of the other two.
struct Mosaic {
  Samples order = Samples::kRggb;
  double contrast = 0;  // largest difference of the four means, of their mean
};
[[nodiscard]] std::optional<Mosaic> mosaicOf(const ImageView& grey);

// Throws InputError for an image of another size than the camera's.
void requireSize(const io::ImageFile& file, const Camera& camera, const std::filesystem::path& path);

// Its brightest sample.
[[nodiscard]] int brightestOf(const ImageView& image);

// The image in another format and of so many bits: grey becomes RGB and RGB grey; samples of 8 bits are
// scaled, others keep their values, but for those above full scale, which are cut to it. Throws InputError
// for an image of more than 8 bits where `bits` are 8.
[[nodiscard]] io::ImageFile fitted(io::ImageFile file, PixelFormat format, int bits,
                                   const std::filesystem::path& path);

// What a camera's images are, by some of them: the format and the bits that hold all, and the size of the
// first.
struct Probed {
  PixelFormat format = PixelFormat::kMono;
  int bits = 8;
  std::array<int, 2> size{0, 0};  // width, height [px]
};

// `names`: of files in `folder`; `option`: that says what samples are. Files that cannot be read are passed
// over. Throws InputError where nobody says that grey images are a mosaic, as they seem to be.
[[nodiscard]] Probed probe(const std::filesystem::path& folder, const std::vector<std::string>& names,
                           Samples samples, const char* option);

}  // namespace fathom::topside
