#pragma once

#include <span>
#include <vector>

#include "recon/geometry/se3.hpp"
#include "recon/lighting/range_lattice.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::topside {

// Ranges over one camera's images, from what is known in the left camera's frame.
class CameraRanges {
 public:
  CameraRanges(const Camera& camera, const SE3& T_cam_left) : T_cam_left_(T_cam_left), maker_(camera) {}

  // To a plane, bent to points [m]. Until the next call.
  const lighting::RangeLattice& of(const stereo::SeedPlane& plane, std::span<const Eigen::Vector3f> points) {
    const Eigen::Vector3d normal = T_cam_left_.rotation() * plane.normal;
    maker_.fromPlane(normal, plane.distance + normal.dot(T_cam_left_.translation()), ranges_);
    points_.clear();
    for (const Eigen::Vector3f& p : points)
      points_.emplace_back((T_cam_left_ * p.cast<double>()).cast<float>());
    maker_.bendTo(points_, ranges_);
    return ranges_;
  }

 private:
  SE3 T_cam_left_;
  lighting::RangeMaker maker_;
  lighting::RangeLattice ranges_;
  std::vector<Eigen::Vector3f> points_;
};

}  // namespace fathom::topside
