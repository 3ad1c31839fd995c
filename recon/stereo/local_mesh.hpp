#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "realtime/base/numbers/union_find.hpp"
#include "recon/stereo/delaunay.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

struct DepthConsistencyConfig {
  double max_slope = 1.4;        // steepest surface, angle between its normal and the line of sight [rad]
  int min_patch_points = 6;      // an isolated patch of fewer points is dropped
  double max_fish_length = 0.6;  // longest group of points that can be an object in mid-water [m]; 0: none
  bool few = false;              // most corners found no match: those that did may be chance
};

// Finds outliers of a stereo frame: points with a depth that contradicts their neighbours in the triangulated
// image. Every comparison allows for three standard deviations of the points.
// 1. Chance, where most corners found no match: in silt a window looks like another one here and there, at
//    any depth. Two neighbours, and half of all, must agree with a point; where fewer than 20 or than half of
//    the points have such neighbours, none is kept.
// 2. Mismatches, else: the inverse depth differs from the median of the neighbours' by more than three
//    standard deviations and three times their median absolute deviation, and fewer than two neighbours agree
//    with it (at the edge of a coral head, points on either side have neighbours at their own depth).
// 3. Fish: points are joined where the edge between them is less steep than 63 degrees. A group is an
//    object in mid-water when the image shows water all round it: it has no point on or beside the outline of
//    the triangulation, and nine in ten of the edges that leave it step down, by at least 0.15 m and by the
//    group's own width. It has at most a quarter of the points and is no longer than max_fish_length. (A
//    boulder or coral head is as wide as it is high or touches the ground on one side; the edge of a drop-off
//    reaches the image's border.)
// 4. Patches: points are joined where the edge between them is no steeper than max_slope; a group of
//    fewer than min_patch_points is a cluster of mismatches or a fish with few corners.
// Cost: linear in the number of points.
class DepthConsistency {
 public:
  enum class Verdict : std::uint8_t { kKeep, kMismatch, kFish };

  // Reserves the memory for this many points.
  explicit DepthConsistency(std::size_t max_points);

  // `triangles`: of the points, in the image plane. `verdicts` gets one for each point.
  void check(const DepthConsistencyConfig& config, std::span<const StereoPoint> points,
             std::span<const std::array<std::uint32_t, 3>> triangles, std::vector<Verdict>& verdicts);

 private:
  struct Node {
    Eigen::Vector3d position;  // [m]
    Eigen::Vector3d sight;     // unit
    double range;              // [m]
    double inverse_depth;      // [1/m]
    double variance;           // along the line of sight [m^2]
  };
  struct Group {
    std::uint32_t points, leaving;   // points; edges that leave the group
    std::uint32_t shallow;           // of these edges, those that step down too little
    bool outline;                    // has a point on or beside the outline of the triangulation
    double x, y, xx, xy, yy, depth;  // sums of x/z, y/z, their products, and of z
    double needed;                   // least step down all round of a fish [m]; 0: not a fish
  };

  void dropChance(std::vector<Verdict>& verdicts);
  void dropMismatches(std::vector<Verdict>& verdicts);
  void dropFish(const DepthConsistencyConfig& config, std::vector<Verdict>& verdicts);
  void dropPatches(const DepthConsistencyConfig& config, std::vector<Verdict>& verdicts);
  // Groups kept points that are joined by edges up to the slope of this tangent; group_[i]: the group's
  // first point.
  void join(double tangent, const std::vector<Verdict>& verdicts);
  [[nodiscard]] int agreeing(std::uint32_t i) const;  // of the point's neighbours
  [[nodiscard]] bool onSurface(const Node& a, const Node& b, double tangent) const;

  std::vector<Node> nodes_;
  TriangleLinks links_;
  std::vector<double> values_;
  UnionFind joined_;
  std::vector<std::uint32_t> group_;
  std::vector<Group> groups_;
};

// The last steps from matched points to a local mesh: outliers in depth are dropped, the other points are
// triangulated in the image plane, and triangles that span separate surfaces are removed.
class LocalMesh {
 public:
  // Reserves the memory for this many points.
  explicit LocalMesh(std::size_t max_points);

  // Drops the outliers that DepthConsistency finds, and counts them in result.rejected.
  void dropOutliers(const SparseStereoConfig& limits, StereoResult& result);

  // Fills result.triangles: Delaunay triangles of the left pixels (rounded) with edges up to max_edge and
  // slopes up to max_slope, without those over parts that `mask`, of the left image, hides.
  void triangulate(const SparseStereoConfig& limits, StereoResult& result, const ImageMask* mask = nullptr);

 private:
  const std::vector<Delaunay::Triangle>& triangulatePixels(const StereoResult& result);

  Delaunay delaunay_;
  DepthConsistency consistency_;
  std::vector<Delaunay::Point> pixels_;
  std::vector<DepthConsistency::Verdict> verdicts_;
};

}  // namespace fathom::stereo
