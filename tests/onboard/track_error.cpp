#include "tests/onboard/track_error.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/pose_files.hpp"

namespace fathom::onboard::testing {

TrackError trackError(const std::filesystem::path& mission, const std::filesystem::path& output) {
  const io::StereoPoseFile poses = io::readStereoPoses(output / "stereo_pose_est.data");
  const auto truth = io::readTrajectory(mission / "truth" / "trajectory.csv");
  const SE3 T_body_cam = io::readMissionConfig(mission).T_body_cam;
  std::vector<Eigen::Vector2d> off;
  Eigen::Vector2d mean(0, 0);
  TrackError error;
  for (const io::StereoPose& pose : poses.poses) {
    const auto after = std::lower_bound(
        truth.begin(), truth.end(), pose.utc_s,
        [](const io::TrajectoryPoint& p, double t) { return static_cast<double>(p.utc_ns) * 1e-9 < t; });
    if (after == truth.end()) continue;
    off.push_back((pose.T_nav_cam.translation() - (after->pose * T_body_cam).translation()).head<2>());
    mean += off.back();
  }
  const auto n = static_cast<double>(off.size());
  mean /= n;
  for (const Eigen::Vector2d& o : off) {
    error.absolute += o.squaredNorm() / n;
    error.shape += (o - mean).squaredNorm() / n;
  }
  return {std::sqrt(error.absolute), std::sqrt(error.shape), mean};
}

}  // namespace fathom::onboard::testing
