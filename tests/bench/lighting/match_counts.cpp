#include "tests/bench/lighting/match_counts.hpp"

#include <cmath>

namespace fathom::bench {

bool MatchCounts::isOuter(const Eigen::Vector2d& pixel) const {
  const Camera& camera = mission_.rig().left;
  const Eigen::Vector2d centre(0.5 * camera.width, 0.5 * camera.height);
  return (pixel - centre).norm() > 2.0 / 3.0 * centre.norm();
}

bool MatchCounts::isCorrect(std::size_t image, const Eigen::Vector2d& pixel, double z) const {
  const auto seafloor = mission_.pointAt(image, pixel);
  if (!seafloor) return false;
  const StereoRig& rig = mission_.rig();
  return rig.left.fx * rig.baseline() * std::abs(1 / seafloor->z() - 1 / z) < 1;
}

void MatchCounts::measure(std::size_t image, const CorrectedPair& pair) {
  const StereoRig& rig = mission_.rig();
  const auto& cameras = mission_.config().cameras;
  const stereo::SeedPlane& plane = mission_.pairs()[image].plane;
  ++pairs_;
  for (std::size_t k = 0; k < Corrections::kCount; ++k) {
    auto left = grey(pair.left[k], rig.left, cameras.left_format);
    auto right = grey(pair.right[k], rig.right, cameras.right_format);
    const auto view = [](const std::vector<std::uint8_t>& data, const Camera& camera) {
      return ImageView{data.data(),        camera.width,
                       camera.height,      static_cast<std::size_t>(camera.width),
                       PixelFormat::kMono, 8};
    };
    Count& count = counts_[k];
    for (const stereo::StereoPoint& point :
         stereo_.process(view(left, rig.left), view(right, rig.right), plane).points) {
      ++count.all;
      const Eigen::Vector2d pixel = point.left.cast<double>();
      if (!isOuter(pixel)) continue;
      ++count.outer;
      if (isCorrect(image, pixel, static_cast<double>(point.point.z()))) ++count.correct_outer;
    }
    peer_.process(cv::Mat(rig.left.height, rig.left.width, CV_8U, left.data()),
                  cv::Mat(rig.right.height, rig.right.width, CV_8U, right.data()), plane, features_);
    for (std::size_t p = 0; p < peer_.points.size(); ++p) {
      ++count.peer_all;
      const Eigen::Vector2d pixel(static_cast<double>(peer_.left[p].x), static_cast<double>(peer_.left[p].y));
      if (isOuter(pixel) && isCorrect(image, pixel, peer_.points[p].z())) ++count.peer_correct_outer;
    }
  }
}

}  // namespace fathom::bench
