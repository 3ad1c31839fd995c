#pragma once

#include <Eigen/Core>
#include <vector>

#include "recon/geometry/stereo_rig.hpp"

namespace fathom::stereo {

// A plane in a camera's frame: normal . p = distance.
struct ViewPlane {
  Eigen::Vector3d normal;
  double distance;  // [m]
};

// Candidate positions in one camera of a pixel of the other: the images of points along the pixel's ray about
// its intersection with the seafloor plane, through the lens distortion of both cameras.
class EpipolarSearch {
 public:
  // `T_to_from` maps points of the rays' frame into that of `to`. `step`: spacing of candidates; `radius`:
  // their reach on each side of the seed [px]. Depths along the ray stay within min_range and max_range [m].
  EpipolarSearch(const Camera& to, const SE3& T_to_from, double step, double radius, double min_range,
                 double max_range);

  // Changes the camera and its pose; the limits stay.
  void look(const Camera& to, const SE3& T_to_from);

  // Candidates in order of falling depth for a ray (x, y, 1); those outside the other image are left out. The
  // result is reused by the next call.
  const std::vector<Eigen::Vector2d>& candidates(const Eigen::Vector3d& ray, const ViewPlane& plane);

  // The same for the seed alone; false when the other camera does not see it with `margin` [px].
  [[nodiscard]] bool seed(const Eigen::Vector3d& ray, const ViewPlane& plane, double margin,
                          Eigen::Vector2d& pixel) const;

 private:
  [[nodiscard]] double seedInverseDepth(const Eigen::Vector3d& ray, const ViewPlane& plane) const;
  [[nodiscard]] bool project(const Eigen::Vector3d& rotated_ray, double inverse_depth,
                             Eigen::Vector2d& pixel) const;

  Camera to_;
  Eigen::Matrix3d rotation_;
  Eigen::Vector3d translation_;  // [m]
  double step_, radius_;         // [px]
  double nearest_, farthest_;    // inverse depth [1/m]
  std::vector<Eigen::Vector2d> candidates_;
};

// Distance of an undistorted right ray (x, y, 1) from the epipolar line of an undistorted left ray, in
// right pixels.
class EpipolarDistance {
 public:
  explicit EpipolarDistance(const StereoRig& rig);
  // Unsigned [px].
  [[nodiscard]] double operator()(const Eigen::Vector3d& left_ray, const Eigen::Vector3d& right_ray) const;
  struct Offset {
    double distance;         // signed, along the normal [px]
    Eigen::Vector2d normal;  // of the line, unit
  };
  [[nodiscard]] Offset offset(const Eigen::Vector3d& left_ray, const Eigen::Vector3d& right_ray) const;

 private:
  Eigen::Matrix3d essential_;  // [t]x R
  double focal_;               // [px]
};

}  // namespace fathom::stereo
