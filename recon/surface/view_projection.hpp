#pragma once

#include <Eigen/Core>
#include <array>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::surface {

// A view in single precision, for points relative to an origin near them.
struct ViewProjection {
  ViewProjection() = default;
  ViewProjection(const Camera& camera, const SE3& T_nav_cam, const Eigen::Vector3d& origin);

  std::array<float, 9> rotation{};  // row by row: camera = rotation * (point - origin) + translation
  std::array<float, 3> translation{};
  float fx = 0, fy = 0, cx = 0, cy = 0;
  float k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
  float width = 0, height = 0;  // [px]
  // Largest (x/z)^2 + (y/z)^2 that is projected: a little beyond the image, and before the distortion folds.
  float limit = 0;
  static constexpr float kNear = 0.05F;  // closest depth [m]

  struct Pixel {
    float u = 0, v = 0, depth = 0;
    bool valid = false;
  };
  [[nodiscard]] Pixel project(float x, float y, float z) const {
    const auto& r = rotation;
    const float px = r[0] * x + r[1] * y + r[2] * z + translation[0];
    const float py = r[3] * x + r[4] * y + r[5] * z + translation[1];
    const float pz = r[6] * x + r[7] * y + r[8] * z + translation[2];
    if (!(pz > kNear)) return {};
    const float a = px / pz, b = py / pz, r2 = a * a + b * b;
    if (!(r2 < limit)) return {};
    const float radial = 1.0F + r2 * (k1 + r2 * (k2 + r2 * k3));
    const float u = fx * (a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a)) + cx;
    const float v = fy * (b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b) + cy;
    return {u, v, pz, true};
  }
  // False only where no point of a sphere is in the image.
  [[nodiscard]] bool mayMeet(const Eigen::Vector3f& middle, float radius) const;
};

}  // namespace fathom::surface
