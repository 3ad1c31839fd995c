#include "recon/geometry/camera.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iomanip>
#include <string>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "recon/geometry/stereo_rig.hpp"

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

namespace {

constexpr double kGrazing = 0.9999;  // largest sine in air
constexpr int kNumbers = 7;          // of a port in its file

// Of the angle in a medium, for the sine in air.
double tangent(double sine, double index) {
  const double s = sine / index;
  return s / std::sqrt(1 - s * s);
}

// Derivative of that.
double tangentSlope(double sine, double index) {
  const double s = sine / index, c2 = 1 - s * s;
  return 1 / (index * c2 * std::sqrt(c2));
}

}  // namespace

Eigen::Vector2d FlatPort::project(const Eigen::Vector3d& point) const {
  const double along = normal.dot(point), water = along - distance - glass;
  const Eigen::Vector3d across = point - along * normal;
  const double r = across.norm();
  constexpr double kOnAxis = 1e-12;  // of the depth
  if (!(water > 0) || r <= kOnAxis * along) return air.project(point);
  // Newton's iteration on the sine in air at which the light reaches the distance r from the axis: the
  // function is convex and rising and the start is beyond the root, so that the sine only falls.
  double sine = std::min(kGrazing, water_index * r / hypotenuse(r, along));
  constexpr int kMaxIterations = 20;
  constexpr double kEnough = 1e-14;
  for (int i = 0; i < kMaxIterations; ++i) {
    const double off = distance * tangent(sine, 1) + glass * tangent(sine, glass_index) +
                       water * tangent(sine, water_index) - r;
    const double slope = distance * tangentSlope(sine, 1) + glass * tangentSlope(sine, glass_index) +
                         water * tangentSlope(sine, water_index);
    const double step = off / slope;
    sine -= step;
    if (std::abs(step) < kEnough) break;
  }
  return air.project(sine / r * across + std::sqrt(1 - sine * sine) * normal);
}

Eigen::Vector3d FlatPort::ray(const Eigen::Vector2d& pixel, double z) const {
  const Eigen::Vector3d in_air = air.ray(pixel).normalized();
  const double cosine = normal.dot(in_air);
  const Eigen::Vector3d across = in_air - cosine * normal;  // of the sine's length
  const double sine = std::min(kGrazing, across.norm());
  if (sine == 0) return in_air / in_air.z();
  const Eigen::Vector3d outwards = across.normalized();
  const Eigen::Vector3d leaves =
      (distance + glass) * normal +
      (distance * tangent(sine, 1) + glass * tangent(sine, glass_index)) * outwards;
  const Eigen::Vector3d in_water = normal + tangent(sine, water_index) * outwards;
  const Eigen::Vector3d there = leaves + std::max(0.0, (z - leaves.z()) / in_water.z()) * in_water;
  return there / there.z();
}

Camera behindPort(const FlatPort& port) {
  const Camera& air = port.air;
  Camera out = air;
  out.port = std::make_shared<const FlatPort>(port);
  // u = cx + F (x R + 2 p1 x y + p2 (r2 + 2 x2)), v = cy + a F (...): linear in cx, cy and F times 1, k1 k2
  // k3 p1 p2, the aspect a being the lens'.
  constexpr int kColumns = 24, kRows = 18, kUnknowns = 8;
  const double aspect = air.fy / air.fx;
  Eigen::Matrix<double, Eigen::Dynamic, kUnknowns> rows(2 * kColumns * kRows, kUnknowns);
  Eigen::VectorXd seen(rows.rows());
  Eigen::Index at = 0;
  for (int j = 0; j < kRows; ++j) {
    for (int i = 0; i < kColumns; ++i, at += 2) {
      const Eigen::Vector2d pixel((air.width - 1.0) * i / (kColumns - 1),
                                  (air.height - 1.0) * j / (kRows - 1));
      const Eigen::Vector3d ray = port.ray(pixel, kPortDepth);
      const double x = ray.x(), y = ray.y(), r2 = x * x + y * y;
      rows.row(at) << 1, 0, x, x * r2, x * r2 * r2, x * r2 * r2 * r2, 2 * x * y, r2 + 2 * x * x;
      rows.row(at + 1) << 0, 1, aspect * y, aspect * y * r2, aspect * y * r2 * r2, aspect * y * r2 * r2 * r2,
          aspect * (r2 + 2 * y * y), aspect * 2 * x * y;
      seen.segment<2>(at) = pixel;
    }
  }
  const Eigen::VectorXd fit = rows.colPivHouseholderQr().solve(seen);
  out.cx = fit(0), out.cy = fit(1), out.fx = fit(2), out.fy = aspect * fit(2);
  out.k1 = fit(3) / fit(2), out.k2 = fit(4) / fit(2), out.k3 = fit(5) / fit(2);
  out.p1 = fit(6) / fit(2), out.p2 = fit(7) / fit(2);
  return out;
}

std::filesystem::path portsBeside(const std::filesystem::path& calibration) {
  return calibration.string() + ".ports";
}

void readPorts(const std::filesystem::path& calibration, StereoRig& rig) {
  const std::filesystem::path path = portsBeside(calibration);
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return;
  NumberFile in(path, "two lines of normal x y z, distance, glass, index of glass, index of water");
  if (in.count() != 2 * kNumbers)
    throw InputError(path, "", "holds " + std::to_string(in.count()) + " numbers; two ports have 14");
  for (Camera* camera : {&rig.left, &rig.right}) {
    FlatPort port{.air = *camera};
    for (int k = 0; k < 3; ++k) port.normal(k) = in.next();
    constexpr double kUnit = 0.01;  // of its length from 1
    if (!(std::abs(port.normal.norm() - 1) < kUnit) || !(port.normal.z() > 0))
      in.fail("the three numbers up to here are no unit normal that points away from the camera");
    port.normal.normalize();
    constexpr double kFarthest = 1, kThickest = 0.2;  // [m]
    port.distance = in.next();
    if (!(port.distance >= 0 && port.distance <= kFarthest)) in.fail("the glass is 0 to 1 m away");
    port.glass = in.next();
    if (!(port.glass >= 0 && port.glass <= kThickest)) in.fail("the glass is 0 to 0.2 m thick");
    for (double* index : {&port.glass_index, &port.water_index}) {
      *index = in.next();
      if (!(*index >= 1 && *index <= 2.5)) in.fail("an index of refraction is 1 to 2.5");
    }
    *camera = behindPort(port);
    for (const double v : {camera->fx, camera->fy, camera->cx, camera->cy, camera->k1, camera->k2, camera->p1,
                           camera->p2, camera->k3})
      if (!std::isfinite(v) || !(camera->fx > 0 && camera->fy > 0))
        in.fail("the port up to here leaves no image to the lens of " + calibration.string());
  }
}

void writePorts(const std::filesystem::path& calibration, const StereoRig& rig) {
  const std::filesystem::path path = portsBeside(calibration);
  if (!rig.left.port && !rig.right.port) {
    std::error_code error;
    std::filesystem::remove(path, error);
    return;
  }
  AtomicFile file(path);
  file.stream() << std::setprecision(17);
  for (const Camera* camera : {&rig.left, &rig.right}) {
    const FlatPort port = camera->port ? *camera->port : FlatPort{.glass_index = 1, .water_index = 1};
    for (const double v : port.normal) file.stream() << v << ' ';
    file.stream() << port.distance << ' ' << port.glass << ' ' << port.glass_index << ' ' << port.water_index
                  << '\n';
  }
  file.commit();
}

}  // namespace fathom
