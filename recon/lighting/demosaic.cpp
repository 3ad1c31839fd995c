#include <algorithm>
#include <cmath>
#include <cstddef>
#include <opencv2/imgproc.hpp>

#include "recon/lighting/lighting_model.hpp"

namespace fathom::lighting {
namespace {

// Codes that turn each format into the wanted one; kCopy where it already is.
constexpr int kCopy = -1;

void convert(const ImageView& image, int from_bayer, int from_mono, int from_rgb, int out_channels,
             std::uint8_t* out) {
  if (image.empty() || image.bits != 8) return;
  const int in_channels = image.format == PixelFormat::kRgb ? 3 : 1;
  // OpenCV has no constant view; the source is only read.
  const cv::Mat in(image.height, image.width, CV_8UC(in_channels), const_cast<void*>(image.data),
                   image.stride);
  cv::Mat result(image.height, image.width, CV_8UC(out_channels), out);
  const int code = image.format == PixelFormat::kBayerRggb ? from_bayer
                   : image.format == PixelFormat::kMono    ? from_mono
                                                           : from_rgb;
  if (code == kCopy)
    in.copyTo(result);
  else
    cv::cvtColor(in, result, code, out_channels);
}

}  // namespace

void demosaicRgb(const ImageView& mosaic, std::uint8_t* out) {
  convert(mosaic, cv::COLOR_BayerRGGB2RGB, cv::COLOR_GRAY2RGB, kCopy, 3, out);
}

namespace {

// Whether a sample of the image's rows [y, y + rows) and columns [x, x + columns) is at `limit` or above.
template <typename T>
bool clipped(const ImageView& image, int x, int y, int columns, int rows, T limit) {
  for (int v = y; v < std::min(y + rows, image.height); ++v) {
    const T* line =
        static_cast<const T*>(image.data) + static_cast<std::size_t>(v) * (image.stride / sizeof(T));
    for (int u = x; u < std::min(x + columns, image.width * (image.format == PixelFormat::kRgb ? 3 : 1)); ++u)
      if (line[u] >= limit) return true;
  }
  return false;
}

template <typename T>
void greyWhere(const ImageView& raw, T limit, std::uint8_t* rgb) {
  // Cells that take their colour from the same samples: one pixel of RGB, 2 x 2 of a mosaic, whose samples
  // reach one pixel farther.
  const bool mosaic = raw.format == PixelFormat::kBayerRggb;
  const int side = mosaic ? 2 : 1, reach = mosaic ? 1 : 0, samples = mosaic ? 2 : 3;
  for (int y = 0; y < raw.height; y += side) {
    if (!clipped(raw, 0, y, raw.width * (mosaic ? 1 : 3), side, limit)) continue;
    for (int x = 0; x < raw.width; x += side) {
      if (!clipped(raw, mosaic ? x : 3 * x, y, samples, side, limit)) continue;
      for (int v = std::max(y - reach, 0); v < std::min(y + side + reach, raw.height); ++v)
        for (int u = std::max(x - reach, 0); u < std::min(x + side + reach, raw.width); ++u) {
          std::uint8_t* pixel = rgb + 3 * (static_cast<std::size_t>(v) * static_cast<std::size_t>(raw.width) +
                                           static_cast<std::size_t>(u));
          pixel[0] = pixel[1] = pixel[2] = std::max({pixel[0], pixel[1], pixel[2]});
        }
    }
  }
}

}  // namespace

void greyWhereClipped(const ImageView& raw, double limit, std::uint8_t* rgb) {
  if (raw.empty() || raw.format == PixelFormat::kMono) return;
  const double level = std::ceil(limit * ((1 << raw.bits) - 1));
  if (raw.bits == 8)
    greyWhere(raw, static_cast<std::uint8_t>(level), rgb);
  else
    greyWhere(raw, static_cast<std::uint16_t>(level), rgb);
}

void demosaicMono(const ImageView& mosaic, std::uint8_t* out) {
  convert(mosaic, cv::COLOR_BayerRGGB2GRAY, kCopy, cv::COLOR_RGB2GRAY, 1, out);
}

}  // namespace fathom::lighting
