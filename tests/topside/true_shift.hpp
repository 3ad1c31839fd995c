#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "firmware_if/mission/pose_files.hpp"

namespace fathom::topside {

inline SE3 truePoseAt(const std::vector<io::TrajectoryPoint>& truth, double utc_s) {
  const auto utc_ns = static_cast<std::int64_t>(utc_s * 1e9);
  const auto after =
      std::lower_bound(truth.begin() + 1, truth.end() - 1, utc_ns,
                       [](const io::TrajectoryPoint& p, std::int64_t t) { return p.utc_ns < t; });
  const auto before = after - 1;
  return interpolate(
      before->pose, after->pose,
      static_cast<double>(utc_ns - before->utc_ns) / static_cast<double>(after->utc_ns - before->utc_ns));
}

// The dive as a whole is as far off as its fixes: the shift that takes this out [m]. Expects what is left of
// every pose to be below `limit` [m].
inline Eigen::Vector3d shiftToTruth(const std::filesystem::path& mission,
                                    const std::filesystem::path& topside, std::size_t pairs, double limit) {
  const auto truth = io::readTrajectory(mission / "truth" / "trajectory.csv");
  const auto poses = io::readVehiclePoses(topside / "vehicle_pose_est.data").poses;
  EXPECT_EQ(poses.size(), pairs);
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  for (const auto& p : poses)
    shift += (truePoseAt(truth, p.utc_s).translation() - p.T_nav_body.translation()) /
             static_cast<double>(poses.size());
  EXPECT_LT(shift.head<2>().norm(), 4.0);
  EXPECT_LT(std::abs(shift.z()), 0.05);
  for (const auto& p : poses)
    EXPECT_LT((p.T_nav_body.translation() + shift - truePoseAt(truth, p.utc_s).translation()).norm(), limit)
        << p.id;
  return shift;
}

}  // namespace fathom::topside
