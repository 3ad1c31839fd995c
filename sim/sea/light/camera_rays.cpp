#include "sim/sea/light/camera_rays.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>

namespace fathom::sim {

CameraRays::CameraRays(const Camera& camera)
    : width_(camera.width),
      height_(camera.height),
      rays_(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height)) {
  oneapi::tbb::parallel_for(0, height_, [&](int y) {
    for (int x = 0; x < width_; ++x)
      rays_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)] =
          camera.undistort({x, y}).cast<float>();
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
