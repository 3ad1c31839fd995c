#include "tests/bench/lighting/match_counts.hpp"

#include <cmath>

namespace fathom::bench {

void MatchCounts::measure(std::size_t image, const CorrectedPair& pair) {
  const StereoRig& rig = mission_.rig();
  const auto& cameras = mission_.config().cameras;
  const ReportMission::Pair& truth = mission_.pairs()[image];
  const Eigen::Vector2d centre(0.5 * rig.left.width, 0.5 * rig.left.height);
  ++pairs_;
  for (std::size_t k = 0; k < Corrections::kCount; ++k) {
    const auto left = grey(pair.left[k], rig.left, cameras.left_format);
    const auto right = grey(pair.right[k], rig.right, cameras.right_format);
    const auto view = [](const std::vector<std::uint8_t>& data, const Camera& camera) {
      return ImageView{data.data(),        camera.width,
                       camera.height,      static_cast<std::size_t>(camera.width),
                       PixelFormat::kMono, 8};
    };
    const stereo::StereoResult& found =
        stereo_.process(view(left, rig.left), view(right, rig.right), truth.plane);
    for (const stereo::StereoPoint& point : found.points) {
      ++counts_[k].all;
      const Eigen::Vector2d pixel = point.left.cast<double>();
      if ((pixel - centre).norm() < 2.0 / 3.0 * centre.norm()) continue;
      ++counts_[k].outer;
      const auto seafloor = mission_.seafloorAt(image, pixel);
      if (!seafloor) continue;
      const double z = (truth.T_nav_cam.inverse() * *seafloor).z();
      const double disparity =
          rig.left.fx * rig.baseline() * std::abs(1 / z - 1 / static_cast<double>(point.point.z()));
      if (disparity < 1) ++counts_[k].correct_outer;
    }
  }
}

}  // namespace fathom::bench
