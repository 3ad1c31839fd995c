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

void demosaicMono(const ImageView& mosaic, std::uint8_t* out) {
  convert(mosaic, cv::COLOR_BayerRGGB2GRAY, kCopy, cv::COLOR_RGB2GRAY, 1, out);
}

}  // namespace fathom::lighting
