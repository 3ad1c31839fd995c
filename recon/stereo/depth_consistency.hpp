#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace fathom::stereo {

struct DepthConsistencyConfig {
  double baseline = 0.07;        // [m]
  double focal = 1700;           // [px]
  double sigma_disparity = 0.1;  // [px]
  double max_slope = 1.4;        // steepest surface, angle between its normal and the line of sight [rad]
  int min_patch_points =
      6;  // a patch of fewer points that no surface joins to its surroundings is not seafloor
};

// Finds the points of a stereo frame whose depth contradicts their neighbours in the triangulated image.
// 1. Mismatches: the disparity differs from the median of the neighbours' by more than three standard
// deviations
//    and three times their median absolute deviation, and fewer than two neighbours agree with it: at the
//    edge of a coral head the points on either side have neighbours of their own kind.
// 2. Floating patches: points are joined where the edge between them, allowing for three standard deviations,
// is no
//    steeper than the steepest surface that a camera sees; a group that has too few points is a fish or a
//    cluster of mismatches.
class DepthConsistency {
 public:
  // `keep[i]` becomes 0 for a point that is found out. `points`: in the left camera frame [m]; `triangles`:
  // of the points.
  void check(const DepthConsistencyConfig& config, std::span<const Eigen::Vector3d> points,
             std::span<const std::array<std::uint32_t, 3>> triangles, std::vector<std::uint8_t>& keep);

 private:
  void linkNeighbours(std::size_t points, std::span<const std::array<std::uint32_t, 3>> triangles);
  void dropMismatches(const DepthConsistencyConfig& config, std::span<const Eigen::Vector3d> points,
                      std::vector<std::uint8_t>& keep);
  void dropPatches(const DepthConsistencyConfig& config, std::span<const Eigen::Vector3d> points,
                   std::vector<std::uint8_t>& keep);

  std::vector<std::uint32_t> first_;  // of each point's neighbours, and one past the last
  std::vector<std::uint32_t> neighbours_;
  std::vector<std::array<std::uint32_t, 2>> edges_;  // both directions, sorted
  std::vector<double> values_, deviations_;
  std::vector<std::uint32_t> group_, size_;
};

}  // namespace fathom::stereo
