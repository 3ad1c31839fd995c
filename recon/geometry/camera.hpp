#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>

namespace fathom {

struct FlatPort;

// Pinhole camera with Brown distortion (radial k1 k2 k3, tangential p1 p2), as OpenCV and the ACFR files use
// it. Pixel (0, 0) is the centre of the top left pixel; camera frame: x right, y down, z along the principal
// ray. Behind a flat port, `port` describes the refraction; the numbers are then those of the central camera
// that is nearest to it under water (behindPort()), and only project() and ray(pixel, depth) are exact.
struct Camera {
  int width = 0;                          // [px]
  int height = 0;                         // [px]
  double fx = 0, fy = 0, cx = 0, cy = 0;  // [px]
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
  std::shared_ptr<const FlatPort> port = {};  // none: no refraction but the lens

  // Distorted pixel of a point in the camera frame [m]; z must be positive.
  [[nodiscard]] Eigen::Vector2d project(const Eigen::Vector3d& point) const;
  // Applies distortion to normalised image coordinates (x/z, y/z).
  [[nodiscard]] Eigen::Vector2d distort(const Eigen::Vector2d& normalised) const;
  // Derivative of the distorted pixel by normalised coordinates (x/z, y/z).
  [[nodiscard]] Eigen::Matrix2d pixelJacobian(const Eigen::Vector2d& normalised) const;
  // Normalised, undistorted coordinates (x/z, y/z) of a distorted pixel: Newton iteration, to about 1e-10.
  [[nodiscard]] Eigen::Vector2d undistort(const Eigen::Vector2d& pixel) const;
  // Ray (x/z, y/z, 1) through a distorted pixel; not of unit length.
  [[nodiscard]] Eigen::Vector3d ray(const Eigen::Vector2d& pixel) const;
  // The same towards the point at a depth of z [m] that the pixel sees, through a flat port if there is one.
  [[nodiscard]] Eigen::Vector3d ray(const Eigen::Vector2d& pixel, double z) const;
  [[nodiscard]] bool contains(const Eigen::Vector2d& pixel, double margin = 0.0) const;
  // The same camera with images resized by `factor` (0.5: half the width), rounded to whole pixels.
  [[nodiscard]] Camera scaled(double factor) const;
};

// Pixel of a point on a ray of another camera: its ray (x, y, 1) turned into this camera's frame, its centre
// in this frame [m], and the point's inverse depth in the other camera [1/m]; without port, zero is infinity.
[[nodiscard]] Eigen::Vector2d projectAt(const Camera& camera, const Eigen::Vector3d& rotated_ray,
                                        const Eigen::Vector3d& translation, double inverse_depth);

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
