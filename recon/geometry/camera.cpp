#include "recon/geometry/camera.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "recon/geometry/flat_port.hpp"

namespace fathom {

Eigen::Vector2d Camera::distort(const Eigen::Vector2d& n) const {
  const double x = n.x(), y = n.y();
  const double r2 = x * x + y * y;
  const double radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
  return {x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
          y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y};
}

Eigen::Vector2d Camera::project(const Eigen::Vector3d& point) const {
  if (port) return port->project(point);
  const Eigen::Vector2d d = distort(point.head<2>() / point.z());
  return {fx * d.x() + cx, fy * d.y() + cy};
}

Eigen::Matrix2d Camera::pixelJacobian(const Eigen::Vector2d& n) const {
  const double x = n.x(), y = n.y();
  const double r2 = x * x + y * y;
  const double radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double slope = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3);  // d radial / d r2
  const double mixed = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
  Eigen::Matrix2d jacobian;
  jacobian << fx * (radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x), fx * mixed, fy * mixed,
      fy * (radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x);
  return jacobian;
}

Eigen::Vector2d Camera::undistort(const Eigen::Vector2d& pixel) const {
  constexpr int kMaxIterations = 20;
  constexpr double kTolerance = 1e-11;  // normalised coordinates
  const Eigen::Vector2d target((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  Eigen::Vector2d n = target;
  for (int i = 0; i < kMaxIterations; ++i) {
    const Eigen::Vector2d d = distort(n);
    const Eigen::Vector2d step =
        pixelJacobian(n).inverse() * Eigen::Vector2d((target.x() - d.x()) * fx, (target.y() - d.y()) * fy);
    if (!step.allFinite()) break;
    n += step;
    if (step.squaredNorm() < kTolerance * kTolerance) break;
  }
  return n;
}

Eigen::Vector3d Camera::ray(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d n = undistort(pixel);
  return {n.x(), n.y(), 1.0};
}

Eigen::Vector3d Camera::ray(const Eigen::Vector2d& pixel, double z) const {
  return port ? port->ray(pixel, z) : ray(pixel);
}

bool Camera::contains(const Eigen::Vector2d& pixel, double margin) const {
  return pixel.x() >= margin && pixel.y() >= margin && pixel.x() <= width - 1 - margin &&
         pixel.y() <= height - 1 - margin;
}

Eigen::Vector2d projectAt(const Camera& camera, const Eigen::Vector3d& rotated_ray,
                          const Eigen::Vector3d& translation, double inverse_depth) {
  const Eigen::Vector3d p = rotated_ray + inverse_depth * translation;
  constexpr double kFarthest = 1e6;  // [m]
  return camera.port ? camera.project(p / std::max(inverse_depth, 1 / kFarthest)) : camera.project(p);
}

Camera Camera::scaled(double factor) const {
  Camera c = *this;
  c.width = static_cast<int>(std::lround(width * factor));
  c.height = static_cast<int>(std::lround(height * factor));
  const double sx = static_cast<double>(c.width) / width;
  const double sy = static_cast<double>(c.height) / height;
  c.fx = fx * sx;
  c.fy = fy * sy;
  c.cx = (cx + 0.5) * sx - 0.5;
  c.cy = (cy + 0.5) * sy - 0.5;
  if (port) {
    FlatPort smaller = *port;
    smaller.air = port->air.scaled(factor);
    c.port = std::make_shared<const FlatPort>(smaller);
  }
  return c;
}

}  // namespace fathom
