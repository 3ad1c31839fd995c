#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::lighting {

// Range over an image: the path length [m] from the camera's centre along the pixel's ray to the seafloor
// (not the depth z), on a lattice from corner to corner. Not positive or not finite: unknown.
struct RangeLattice {
  static constexpr int kColumns = 33, kRows = 25;
  std::array<float, kColumns * kRows> path{};
  // Where rays meet it, and its unit normal there, towards the camera; as far as ranges are known.
  struct Ground {
    Eigen::Vector3f point = Eigen::Vector3f::Zero(), normal = -Eigen::Vector3f::UnitZ();
  };
  std::array<Ground, kColumns * kRows> ground;

  // Bilinear, `u` and `v` in parts of the image's width and height (0 to 1). 0 where a neighbour is unknown.
  [[nodiscard]] float at(float u, float v) const;
  [[nodiscard]] Ground groundAt(float u, float v) const;
};

// Makes the ranges of one camera's images. Allocates nothing.
class RangeMaker {
 public:
  explicit RangeMaker(const Camera& camera);

  // Of a plane in the camera frame: `normal` points away from the camera (to larger z), `distance` along it
  // from the camera's centre [m]. Rays that do not meet it within 50 m are unknown.
  void fromPlane(const Eigen::Vector3d& normal, double distance, RangeLattice& out) const;

  // Scales the lattice's ranges to stereo points in the camera frame [m]: each node by the mean ratio (of
  // logarithms, weighted by nearness) of the points about it; nodes without points take the ratio of their
  // neighbours. Without any point the lattice stays.
  void bendTo(std::span<const Eigen::Vector3f> points, RangeLattice& lattice) const;

 private:
  void findGround(RangeLattice& lattice) const;

  Camera camera_;
  std::array<Eigen::Vector3f, RangeLattice::kColumns * RangeLattice::kRows> rays_;  // unit
};

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
