#include "tests/bench/texture/multi_band_peer.hpp"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/stitching/detail/blenders.hpp>

namespace fathom::surface {

RgbImage multiBandPeer(const std::vector<RgbImage>& layers,
                       const std::vector<std::vector<std::uint8_t>>& seen,
                       const std::vector<std::uint64_t>& region) {
  if (layers.empty()) return {};
  const int width = layers[0].width, height = layers[0].height;
  cv::detail::MultiBandBlender blender(false, 5);
  blender.prepare(cv::Rect(0, 0, width, height));
  for (std::size_t k = 0; k < layers.size(); ++k) {
    cv::Mat mask(height, width, CV_8U, cv::Scalar(0)), wide;
    for (std::size_t i = 0; i < region.size(); ++i)
      mask.data[i] = region[i] == k + 1 && seen[k][i] != 0 ? 255 : 0;
    const cv::Mat image(height, width, CV_8UC3, const_cast<std::uint8_t*>(layers[k].rgb.data()));
    image.convertTo(wide, CV_16S);
    blender.feed(wide, mask, {0, 0});
  }
  cv::Mat result, mask, bytes;
  blender.blend(result, mask);
  result.convertTo(bytes, CV_8U);
  RgbImage out{width, height, {}};
  out.rgb.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y) std::copy_n(bytes.ptr(y), 3 * width, out.at(0, y));
  return out;
}

}  // namespace fathom::surface
