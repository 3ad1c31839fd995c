#pragma once

#include <filesystem>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom {

// Two cameras; the stereo frame is the left camera's.
struct StereoRig {
  Camera left;
  Camera right;
  SE3 T_right_left;  // maps points of the left camera frame into the right's

  [[nodiscard]] double baseline() const { return T_right_left.inverse().translation().norm(); }  // [m]
  [[nodiscard]] StereoRig scaled(double factor) const {
    return {left.scaled(factor), right.scaled(factor), T_right_left};
  }
};

// The same point of the scene in both images, whether or not it fits the calibration [px].
struct RigMatch {
  Eigen::Vector2d left, right;

  static void exchange(auto& archive, auto& self) { archive(self.left, self.right); }
};

// Reads an ACFR stereo.calib (55, 57 or 100 numbers; see "stereo.calib" of the mission folder). Throws
// InputError naming the count, or the number out of range: focal length, size, a rotation that is none, a
// zero baseline. Flat ports come from the file beside it (readPorts()).
[[nodiscard]] StereoRig readStereoCalib(const std::filesystem::path& path);

// Writes 55 numbers, or 57 when a k3 is not zero; to a temporary name first, then renamed. The same for
// ports.
void writeStereoCalib(const std::filesystem::path& path, const StereoRig& rig);

// Midpoint of the shortest segment between the rays from the two camera centres, in the left camera frame
// [m]. `left_ray`, `right_ray`: in their own camera's frame, any length. `gap`: length of that segment [m].
// Returns false (and leaves the outputs) when the rays are parallel or meet behind a camera.
[[nodiscard]] bool triangulateMidpoint(const StereoRig& rig, const Eigen::Vector3d& left_ray,
                                       const Eigen::Vector3d& right_ray, Eigen::Vector3d& point, double& gap);
// The same from distorted pixels [px]; through flat ports, with the rays of the depth found.
[[nodiscard]] bool triangulatePixels(const StereoRig& rig, const Eigen::Vector2d& left,
                                     const Eigen::Vector2d& right, Eigen::Vector3d& point, double& gap);
// Rays (x, y, 1) of two pixels, each in its own camera's frame; behind flat ports those of the depth at which
// they meet, if they do.
struct RayPair {
  Eigen::Vector3d left, right;
};
[[nodiscard]] RayPair raysOf(const StereoRig& rig, const Eigen::Vector2d& left, const Eigen::Vector2d& right);

}  // namespace fathom
