#include "recon/import/images/image_samples.hpp"

#include <gdal_priv.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <fstream>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "firmware_if/mission/images/image_pixels.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"

namespace fathom::topside {
namespace {

constexpr std::size_t kProbed = 32;  // images of a camera

// What samples of 16 bits really have, by the brightest of some images: a converter's full scale where it was
// reached, else as much again as they show, for images that are brighter.
int bitsBy(int brightest) {
  constexpr int kLeast = 9, kMost = 16;
  const int bits = std::bit_width(static_cast<unsigned>(brightest));
  const bool full = brightest == (1 << bits) - 1;
  return std::clamp(full ? bits : bits + 1, kLeast, kMost);
}

}  // namespace

Probed probe(const std::filesystem::path& folder, const std::vector<std::string>& names, Samples samples,
             const char* option) {
  Probed out;
  std::optional<Mosaic> mosaic;
  const std::size_t step = std::max<std::size_t>(1, names.size() / kProbed);
  bool first = true;
  int brightest = -1;  // of more than 8 bits
  for (std::size_t k = 0; k < names.size(); k += step) {
    try {
      const io::ImageFile file = readSamples(folder / names[k], samples);
      const ImageView& view = file.view;
      if (view.bits > 8) brightest = std::max(brightest, brightestOf(view));
      if (first || view.format == PixelFormat::kRgb) out.format = view.format;
      if (first) out.size = {view.width, view.height};
      if (first && samples == Samples::kAuto && out.format == PixelFormat::kMono) mosaic = mosaicOf(view);
      first = false;
    } catch (const InputError&) {  // counted where it is used
    }
  }
  if (brightest >= 0) out.bits = bitsBy(brightest);
  if (mosaic && out.format == PixelFormat::kMono)
    throw InputError(
        folder / names.front(), "",
        formatted("looks like a Bayer mosaic (every other pixel differs by %.0f %%): give %s %s, or "
                  "another order, or mono if it is none",
                  100 * mosaic->contrast, option,
                  sampleNames()[static_cast<std::size_t>(mosaic->order)].c_str()));
  return out;
}

namespace {

// A view for OpenCV, which writes to none of what it is given to read.
cv::Mat matOf(const ImageView& view) {
  const int depth = view.bits == 8 ? CV_8U : CV_16U;
  return {view.height, view.width, CV_MAKETYPE(depth, view.format == PixelFormat::kRgb ? 3 : 1),
          const_cast<void*>(view.data), view.stride};
}

io::ImageFile fileOf(const cv::Mat& image, PixelFormat format, int bits) {
  io::TiffPixels pixels{image.cols, image.rows, image.channels(), image.depth() == CV_8U ? 8 : 16, {}};
  pixels.bytes.assign(image.datastart, image.dataend);
  return io::imageFileOf(std::move(pixels), format, bits);
}

bool isJpegOrPng(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  const int first = in.get(), second = in.get();
  return (first == 0xff && second == 0xd8) || (first == 0x89 && second == 'P');
}

// Grey, or the first three bands of an image of more.
std::optional<io::ImageFile> readByGdal(const std::filesystem::path& path) {
  GDALAllRegister();
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  const std::unique_ptr<GDALDataset> set(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY));
  io::TiffPixels pixels;
  bool good = set != nullptr && set->GetRasterCount() > 0;
  if (good) {
    pixels.width = set->GetRasterXSize();
    pixels.height = set->GetRasterYSize();
    pixels.channels = set->GetRasterCount() < 3 ? 1 : 3;
    const GDALDataType type = set->GetRasterBand(1)->GetRasterDataType();
    good = (type == GDT_Byte || type == GDT_UInt16) && pixels.width > 0 && pixels.height > 0 &&
           static_cast<std::size_t>(pixels.width) <=
               io::kMaxTiffPixels / static_cast<std::size_t>(pixels.height);
    if (good) {
      pixels.bits = type == GDT_Byte ? 8 : 16;
      const int sample = pixels.bits / 8, step = sample * pixels.channels;
      pixels.bytes.resize(static_cast<std::size_t>(pixels.width) * static_cast<std::size_t>(pixels.height) *
                          static_cast<std::size_t>(step));
      int bands[] = {1, 2, 3};
      good = set->RasterIO(GF_Read, 0, 0, pixels.width, pixels.height, pixels.bytes.data(), pixels.width,
                           pixels.height, type, pixels.channels, bands, step,
                           static_cast<GSpacing>(step) * pixels.width, sample) == CE_None;
    }
  }
  if (!good) return std::nullopt;
  const int bits = io::usedBits(pixels);
  const PixelFormat format = pixels.channels == 3 ? PixelFormat::kRgb : PixelFormat::kMono;
  return io::imageFileOf(std::move(pixels), format, bits);
}

io::ImageFile readWhatever(const std::filesystem::path& path) {
  try {
    return io::readAnyImage(path);
  } catch (const InputError&) {
    // Of a damaged JPEG or PNG, GDAL would give what is left.
    if (!std::filesystem::is_regular_file(path) || isJpegOrPng(path)) throw;
    if (auto file = readByGdal(path)) return std::move(*file);
    throw;
  }
}

}  // namespace

const std::vector<std::string>& sampleNames() {
  static const std::vector<std::string> kNames{"auto",       "mono",       "rgb",       "bayer-rggb",
                                               "bayer-bggr", "bayer-grbg", "bayer-gbrg"};
  return kNames;
}

Samples samplesNamed(const std::string& name) {
  const auto& names = sampleNames();
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) throw InputError("format", name, "is none of auto, mono, rgb, bayer-rggb, ...");
  return static_cast<Samples>(found - names.begin());
}

io::ImageFile readSamples(const std::filesystem::path& path, Samples samples) {
  io::ImageFile file = readWhatever(path);
  const bool grey = file.view.format == PixelFormat::kMono;
  const int bits = file.view.bits;
  if (samples == Samples::kAuto)
    samples = !grey                                     ? Samples::kRgb
              : path.stem().string().ends_with("_LC16") ? Samples::kRggb
                                                        : Samples::kMono;
  switch (samples) {
    case Samples::kAuto:
    case Samples::kMono:
      return fitted(std::move(file), PixelFormat::kMono, bits, path);
    case Samples::kRgb:
      return fitted(std::move(file), PixelFormat::kRgb, bits, path);
    case Samples::kRggb:
      if (grey) file.view.format = PixelFormat::kBayerRggb;
      return file;
    case Samples::kBggr:
    case Samples::kGrbg:
    case Samples::kGbrg:
      break;
  }
  if (!grey) return file;
  const int code = samples == Samples::kBggr   ? cv::COLOR_BayerBGGR2RGB
                   : samples == Samples::kGrbg ? cv::COLOR_BayerGRBG2RGB
                                               : cv::COLOR_BayerGBRG2RGB;
  cv::Mat rgb;
  cv::cvtColor(matOf(file.view), rgb, code);
  return fileOf(rgb, PixelFormat::kRgb, file.view.bits);
}

std::optional<Mosaic> mosaicOf(const ImageView& grey) {
  constexpr double kContrast = 0.03, kAlike = 0.3;  // of the mean; of the largest difference
  std::array<double, 4> means{};                    // row by row of the square
  const cv::Mat image = matOf(grey);
  const cv::Mat whole = image(cv::Rect(0, 0, image.cols / 2 * 2, image.rows / 2 * 2));
  for (int y = 0; y < whole.rows; ++y)
    for (int x = 0; x < whole.cols; ++x)
      means[static_cast<std::size_t>(y % 2 * 2 + x % 2)] +=
          grey.bits == 8 ? whole.at<std::uint8_t>(y, x) : whole.at<std::uint16_t>(y, x);
  const auto [least, most] = std::minmax_element(means.begin(), means.end());
  const double spread = *most - *least, mean = (means[0] + means[1] + means[2] + means[3]) / 4;
  if (!(spread > kContrast * mean)) return std::nullopt;
  const double falling = std::abs(means[0] - means[3]), rising = std::abs(means[1] - means[2]);
  if (std::min(falling, rising) > kAlike * spread) return std::nullopt;
  if (rising < falling) return Mosaic{means[0] < means[3] ? Samples::kRggb : Samples::kBggr, spread / mean};
  return Mosaic{means[1] < means[2] ? Samples::kGrbg : Samples::kGbrg, spread / mean};
}

int brightestOf(const ImageView& image) {
  double most = 0;
  cv::minMaxLoc(matOf(image).reshape(1), nullptr, &most);
  return static_cast<int>(most);
}

void requireSize(const io::ImageFile& file, const Camera& camera, const std::filesystem::path& path) {
  if (file.view.width != camera.width || file.view.height != camera.height)
    throw InputError(path, "",
                     "is " + std::to_string(file.view.width) + " x " + std::to_string(file.view.height) +
                         " where the calibration says " + std::to_string(camera.width) + " x " +
                         std::to_string(camera.height));
}

io::ImageFile fitted(io::ImageFile file, PixelFormat format, int bits, const std::filesystem::path& path) {
  if (file.view.bits > 8 && bits == 8)
    throw InputError(path, "",
                     "has samples of " + std::to_string(file.view.bits) + " bits where other images have 8");
  const bool colours = file.view.format == PixelFormat::kRgb, wanted = format == PixelFormat::kRgb;
  cv::Mat image = matOf(file.view);
  if (colours != wanted) cv::cvtColor(image, image, wanted ? cv::COLOR_GRAY2RGB : cv::COLOR_RGB2GRAY);
  if (file.view.bits == 8 && bits > 8) image.convertTo(image, CV_16U, static_cast<double>(1 << (bits - 8)));
  if (file.view.bits > bits) cv::min(image, (1 << bits) - 1, image);
  if (image.data != file.view.data) return fileOf(image, format, bits);
  file.view.format = format;
  file.view.bits = bits;
  return file;
}

}  // namespace fathom::topside
