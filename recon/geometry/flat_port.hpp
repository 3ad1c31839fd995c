#pragma once

#include <Eigen/Core>
#include <filesystem>

#include "recon/geometry/camera.hpp"

namespace fathom {

struct StereoRig;

// A camera in air behind a plane of glass, water beyond: light bends at both faces, so that rays of different
// pixels do not meet in one point (Treibitz et al. 2012, "Flat refractive geometry", IEEE PAMI 34, 2).
struct FlatPort {
  Camera air = {};                                    // the camera without port and water
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  // of the glass, towards the water; camera frame, unit
  double distance = 0;                                // centre of projection to the inner face [m]
  double glass = 0;                                   // thickness [m]
  double glass_index = 1.49;                          // of refraction, against air; acrylic
  double water_index = 1.339;                         // sea water

  // Distorted pixel of a point in the water, in the camera frame [m]; z must be positive. A point before the
  // water is seen as in air. Snell's law, solved for the ray's slope in air by Newton's iteration.
  [[nodiscard]] Eigen::Vector2d project(const Eigen::Vector3d& point) const;
  // (x/z, y/z, 1) from the centre of projection to where a pixel's light comes from at a depth of z [m].
  [[nodiscard]] Eigen::Vector3d ray(const Eigen::Vector2d& pixel, double z) const;
};

// The depth at which a camera behind a port is described by one without [m]: a survey vehicle's altitude.
inline constexpr double kPortDepth = 2.0;

// A camera with this port. Its own numbers are those of the camera without port that sees points at
// kPortDepth at the same pixels (least squares; to a few hundredths of a pixel for a port near the lens).
[[nodiscard]] Camera behindPort(const FlatPort& port);

// Of FILE.ports beside a calibration FILE, where there is one: a line for each camera, left first, of
//   normal x y z, distance to the glass [m], its thickness [m], its index of refraction, the water's
// The calibration then is that of the cameras in air. Throws InputError naming the number that is out of
// range.
[[nodiscard]] std::filesystem::path portsBeside(const std::filesystem::path& calibration);
void readPorts(const std::filesystem::path& calibration, StereoRig& rig);
// Writes it, or removes it where neither camera has a port.
void writePorts(const std::filesystem::path& calibration, const StereoRig& rig);

}  // namespace fathom
