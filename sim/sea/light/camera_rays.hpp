#pragma once

#include <Eigen/Core>
#include <vector>

#include "recon/geometry/camera.hpp"

namespace fathom::sim {

// The rays of every pixel of a distorted camera under water, in the camera frame; behind a flat port traced
// through both faces of the glass by Snell's law.
class CameraRays {
 public:
  explicit CameraRays(const Camera& camera);
  // (x/z, y/z) through the centre of pixel (x, y).
  [[nodiscard]] const Eigen::Vector2f& at(int x, int y) const {
    return rays_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                 static_cast<std::size_t>(x)];
  }
  // Likewise, (dx, dy) pixels off the centre, |dx|, |dy| < 1: from the change between neighbours.
  [[nodiscard]] Eigen::Vector2f near(int x, int y, float dx, float dy) const;
  // Where that ray enters the water [m]; the camera's centre without a port.
  [[nodiscard]] Eigen::Vector3f origin(int x, int y) const {
    if (origins_.empty()) return Eigen::Vector3f::Zero();
    return origins_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                    static_cast<std::size_t>(x)];
  }

 private:
  int width_, height_;
  std::vector<Eigen::Vector2f> rays_;
  std::vector<Eigen::Vector3f> origins_;  // behind a port
};

}  // namespace fathom::sim
