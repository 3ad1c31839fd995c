#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "recon/fusion/space_division.hpp"
#include "recon/geometry/pose_variance.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/topside/localise/slam_stage.hpp"
#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

// How well the poses of a dive are known, for the surfaces that they place (addPoseVariance).
class PoseDoubt {
 public:
  // `uncertain`: of pairs in rising order, some of the dive's; a pair has the covariance of the nearest one
  // in order. None: nothing is added. They must outlive it.
  PoseDoubt() = default;
  explicit PoseDoubt(std::span<const SlamResult::Uncertain> uncertain) : uncertain_(uncertain) {}

  // Of `pairs`, for addPoseVariance(); `T_nav_cam`, `footprints`: of every pair.
  [[nodiscard]] std::vector<UncertainView> viewsOf(
      const std::vector<std::uint32_t>& pairs, const std::vector<SE3>& T_nav_cam,
      const std::vector<fusion::MeshFootprint>& footprints) const;
  // What viewsOf() takes of a pair.
  void addKey(Hasher& hasher, std::uint32_t pair) const;

 private:
  [[nodiscard]] const Matrix6d& nearest(std::uint32_t pair) const;

  std::span<const SlamResult::Uncertain> uncertain_;
};

}  // namespace fathom::topside
