#include "sim/sea/light/camera_rays.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "recon/geometry/flat_port.hpp"

namespace fathom::sim {
namespace {

// Snell's law for unit vectors: light of direction `d` meets a face of unit normal `n` (d . n > 0).
Eigen::Vector3d refracted(const Eigen::Vector3d& d, const Eigen::Vector3d& n, double from, double to) {
  const double ratio = from / to, cosine = d.dot(n);
  return ratio * d + (std::sqrt(1 - ratio * ratio * (1 - cosine * cosine)) - ratio * cosine) * n;
}

struct WaterRay {
  Eigen::Vector3d origin, direction;
};

// From the camera's centre through the glass.
WaterRay throughPort(const FlatPort& port, const Eigen::Vector2d& pixel) {
  const Eigen::Vector3d& n = port.normal;
  const Eigen::Vector2d lens = port.air.undistort(pixel);
  const Eigen::Vector3d in_air = Eigen::Vector3d(lens.x(), lens.y(), 1).normalized();
  const Eigen::Vector3d inner = port.distance / in_air.dot(n) * in_air;
  const Eigen::Vector3d in_glass = refracted(in_air, n, 1, port.glass_index);
  const Eigen::Vector3d outer = inner + port.glass / in_glass.dot(n) * in_glass;
  return {outer, refracted(in_glass, n, port.glass_index, port.water_index)};
}

}  // namespace

CameraRays::CameraRays(const Camera& camera)
    : width_(camera.width),
      height_(camera.height),
      rays_(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height)) {
  if (camera.port) origins_.resize(rays_.size());
  oneapi::tbb::parallel_for(0, height_, [&](int y) {
    for (int x = 0; x < width_; ++x) {
      const std::size_t at =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
      if (camera.port) {
        const WaterRay ray = throughPort(*camera.port, {x, y});
        origins_[at] = ray.origin.cast<float>();
        rays_[at] = (ray.direction.head<2>() / ray.direction.z()).cast<float>();
      } else {
        rays_[at] = camera.undistort({x, y}).cast<float>();
      }
    }
  });
}

Eigen::Vector2f CameraRays::near(int x, int y, float dx, float dy) const {
  const int x0 = std::max(0, x - 1), x1 = std::min(width_ - 1, x + 1);
  const int y0 = std::max(0, y - 1), y1 = std::min(height_ - 1, y + 1);
  Eigen::Vector2f ray = at(x, y);
  if (x1 > x0) ray += dx / static_cast<float>(x1 - x0) * (at(x1, y) - at(x0, y));
  if (y1 > y0) ray += dy / static_cast<float>(y1 - y0) * (at(x, y1) - at(x, y0));
  return ray;
}

}  // namespace fathom::sim
