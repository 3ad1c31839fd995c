#pragma once

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/pose_files.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::onboard::testing {

// RMS distance in plan of a replay's stereo poses from the true ones [m].
struct TrackError {
  double absolute = 0;
  double shape = 0;                                 // after taking out the mean shift
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();  // that is it, north and east
};

// `output`: the folder that the replay wrote. The mission has truth/.
[[nodiscard]] inline TrackError trackError(const std::filesystem::path& mission,
                                           const std::filesystem::path& output) {
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

// The first pose from then on, or the last.
[[nodiscard]] inline SE3 poseAt(const std::vector<io::TrajectoryPoint>& track, std::int64_t utc_ns) {
  const auto after =
      std::lower_bound(track.begin(), track.end(), utc_ns,
                       [](const io::TrajectoryPoint& p, std::int64_t t) { return p.utc_ns < t; });
  return (after == track.end() ? track.back() : *after).pose;
}

// Every file of `folder` is the same in `again`, but for the measured times; how many there are.
inline int expectSameFiles(const std::filesystem::path& folder, const std::filesystem::path& again) {
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const auto name = entry.path().filename();
    if (name == "timing.json") continue;
    EXPECT_TRUE(test::readText(entry.path()) == test::readText(again / name)) << name;
    ++files;
  }
  return files;
}

}  // namespace fathom::onboard::testing
