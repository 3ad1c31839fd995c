#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware_if/files/images/image_file.hpp"
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

// Throws InputError for an image of another size than the camera's.
void requireSize(const io::ImageFile& file, const Camera& camera, const std::filesystem::path& path);

// The image in another format and at least as many bits: grey becomes RGB and RGB grey; of samples of 8 bits
// more are made by their scale, others keep their values. Throws InputError for a sample of more than `bits`.
[[nodiscard]] io::ImageFile fitted(io::ImageFile file, PixelFormat format, int bits,
                                   const std::filesystem::path& path);

}  // namespace fathom::topside
