#pragma once

#include <span>

#include "recon/geometry/stereo_rig.hpp"
#include "recon/lighting/range_lattice.hpp"

namespace fathom::lighting {

// Ranges of the two images of a stereo pair, from a plane and points in the left camera's frame.
class RigRanges {
 public:
  explicit RigRanges(const StereoRig& rig)
      : T_right_left_(rig.T_right_left), left_maker_(rig.left), right_maker_(rig.right) {}

  // The seafloor as a plane: `normal` of unit length, away from the camera; `distance` along it [m].
  void fromPlane(const Eigen::Vector3d& normal, double distance) {
    left_maker_.fromPlane(normal, distance, left_);
    const Eigen::Vector3d right_normal = T_right_left_.rotation() * normal;
    right_maker_.fromPlane(right_normal, distance + right_normal.dot(T_right_left_.translation()), right_);
  }
  // Bends both to stereo's points (left camera frame [m]); `right_points` is room for as many.
  void bendTo(std::span<const Eigen::Vector3f> points, std::span<Eigen::Vector3f> right_points) {
    left_maker_.bendTo(points, left_);
    for (std::size_t k = 0; k < points.size(); ++k)
      right_points[k] = (T_right_left_ * points[k].cast<double>()).cast<float>();
    right_maker_.bendTo(right_points.first(points.size()), right_);
  }

  [[nodiscard]] const RangeLattice& left() const { return left_; }
  [[nodiscard]] const RangeLattice& right() const { return right_; }

 private:
  SE3 T_right_left_;
  RangeMaker left_maker_, right_maker_;
  RangeLattice left_, right_;
};

}  // namespace fathom::lighting
