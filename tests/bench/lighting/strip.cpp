#include "tests/bench/lighting/strip.hpp"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace fathom::bench {
namespace {

constexpr int kFrameWidth = 240;  // of a strip [px]

cv::Mat colour(const TrueMission& mission, const std::vector<std::uint8_t>& image) {
  const Camera& camera = mission.rig().left;
  std::vector<std::uint8_t> rgb(image.size() * 3);
  lighting::demosaicRgb({image.data(), camera.width, camera.height, static_cast<std::size_t>(camera.width),
                         mission.config().cameras.left_format, 8},
                        rgb.data());
  const cv::Mat view(camera.height, camera.width, CV_8UC3, rgb.data());
  cv::Mat bgr;
  cv::cvtColor(view, bgr, cv::COLOR_RGB2BGR);
  return bgr;
}

}  // namespace

void Strip::add(const CorrectedPair& pair) {
  for (std::size_t row = 0; row < corrections_.size(); ++row)
    rows_[row].push_back(pair.left[static_cast<std::size_t>(corrections_[row])]);
}

void Strip::write(const std::filesystem::path& png) const {
  const Camera& camera = mission_.rig().left;
  const int height = kFrameWidth * camera.height / camera.width;
  cv::Mat strip(static_cast<int>(rows_.size()) * height,
                static_cast<int>(rows_.empty() ? 0 : rows_[0].size()) * kFrameWidth, CV_8UC3);
  for (std::size_t row = 0; row < rows_.size(); ++row)
    for (std::size_t k = 0; k < rows_[row].size(); ++k) {
      cv::Mat small;
      cv::resize(colour(mission_, rows_[row][k]), small, {kFrameWidth, height}, 0, 0, cv::INTER_AREA);
      small.copyTo(
          strip({static_cast<int>(k) * kFrameWidth, static_cast<int>(row) * height, kFrameWidth, height}));
    }
  if (!strip.empty()) cv::imwrite(png.string(), strip);
}

void Strip::writePair(const TrueMission& mission, const CorrectedPair& pair, int before, int after,
                      const std::filesystem::path& png) {
  cv::Mat both;
  cv::vconcat(colour(mission, pair.left[static_cast<std::size_t>(before)]),
              colour(mission, pair.left[static_cast<std::size_t>(after)]), both);
  cv::imwrite(png.string(), both);
}

}  // namespace fathom::bench
