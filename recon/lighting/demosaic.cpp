#include "recon/lighting/demosaic.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

namespace fathom::lighting {
namespace {

// OpenCV's conversion from the image's format to RGB, or a copy of it.
void convert(const ImageView& image, std::optional<int> conversion, int out_channels, std::uint8_t* out) {
  if (image.empty() || image.bits != 8) return;
  const int in_channels = image.format == PixelFormat::kRgb ? 3 : 1;
  // OpenCV has no constant view; the source is only read.
  const cv::Mat in(image.height, image.width, CV_8UC(in_channels), const_cast<void*>(image.data),
                   image.stride);
  cv::Mat result(image.height, image.width, CV_8UC(out_channels), out);
  if (conversion)
    cv::cvtColor(in, result, *conversion, out_channels);
  else
    in.copyTo(result);
}

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
void neutraliseAbove(const ImageView& raw, T limit, std::uint8_t* rgb) {
  // Cells of pixels that share samples: one pixel of RGB; 2 x 2 of a mosaic, whose samples also enter the
  // pixels around by demosaicing.
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

void demosaicRgb(const ImageView& mosaic, std::uint8_t* out) {
  std::optional<int> conversion;
  if (mosaic.format == PixelFormat::kBayerRggb) conversion = cv::COLOR_BayerRGGB2RGB;
  if (mosaic.format == PixelFormat::kMono) conversion = cv::COLOR_GRAY2RGB;
  convert(mosaic, conversion, 3, out);
}

void neutraliseClipped(const ImageView& raw, double limit, std::uint8_t* rgb) {
  if (raw.empty() || raw.format == PixelFormat::kMono) return;
  const double level = std::ceil(limit * ((1 << raw.bits) - 1));
  if (raw.bits == 8)
    neutraliseAbove(raw, static_cast<std::uint8_t>(level), rgb);
  else
    neutraliseAbove(raw, static_cast<std::uint16_t>(level), rgb);
}

void greyOf(const ImageView& mosaic, const GreyShares& shares, std::uint8_t* rgb, std::uint8_t* grey) {
  if (mosaic.empty() || mosaic.bits != 8) return;
  if (mosaic.format == PixelFormat::kMono) {
    convert(mosaic, std::nullopt, 1, grey);
    return;
  }
  demosaicRgb(mosaic, rgb);
  const std::size_t pixels = static_cast<std::size_t>(mosaic.width) * static_cast<std::size_t>(mosaic.height);
  const auto share = [&](std::size_t c) { return cv::v_setall_u16(shares[c]); };
  const cv::v_uint16x8 red = share(0), green = share(1), blue = share(2), half = cv::v_setall_u16(kWhole / 2);
  constexpr std::size_t kAtOnce = 16;
  std::size_t k = 0;
  for (; k + kAtOnce <= pixels; k += kAtOnce) {
    cv::v_uint8x16 r, g, b;
    cv::v_load_deinterleave(rgb + 3 * k, r, g, b);
    cv::v_uint16x8 r0, r1, g0, g1, b0, b1;
    cv::v_expand(r, r0, r1);
    cv::v_expand(g, g0, g1);
    cv::v_expand(b, b0, b1);
    const auto mixed = [&](const cv::v_uint16x8& of_red, const cv::v_uint16x8& of_green,
                           const cv::v_uint16x8& of_blue) {
      return cv::v_shr<kShareBits>(cv::v_mul_wrap(of_red, red) + cv::v_mul_wrap(of_green, green) +
                                   cv::v_mul_wrap(of_blue, blue) + half);
    };
    cv::v_store(grey + k, cv::v_pack(mixed(r0, g0, b0), mixed(r1, g1, b1)));
  }
  for (; k < pixels; ++k) {
    const std::uint8_t* at = rgb + 3 * k;
    grey[k] = static_cast<std::uint8_t>(
        (shares[0] * at[0] + shares[1] * at[1] + shares[2] * at[2] + kWhole / 2) / kWhole);
  }
}

}  // namespace fathom::lighting
