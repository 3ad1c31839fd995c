#pragma once

#include <Eigen/Core>
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

}  // namespace fathom
