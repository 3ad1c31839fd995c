#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::surface {

// A view in single precision, for points relative to an origin near them.
class ViewProjection {
 public:
  ViewProjection() = default;
  ViewProjection(const Camera& camera, const SE3& T_nav_cam, const Eigen::Vector3d& origin);

  // Row by row: camera = rotation * (point - origin) + translation. Behind a flat port the frame's z is the
  // port's normal, and (x, y, z) of the lens = into_lens * (x, y, z) of this frame in air.
  std::array<float, 9> rotation{};
  std::array<float, 3> translation{};
  float fx = 0, fy = 0, cx = 0, cy = 0;
  float k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
  float width = 0, height = 0;  // [px]
  // Largest (x/z)^2 + (y/z)^2 that is projected: a little beyond the image, and before the distortion folds.
  float limit = 0;
  static constexpr float kNear = 0.05F;  // closest depth [m]
  bool ported = false;
  std::array<float, 9> into_lens{};
  float gap = 0, glass = 0;               // before and of the port's glass [m]
  float bend_water = 0;                   // its index of refraction squared, less 1
  float index_water = 1, slow_glass = 1;  // index of refraction; of water over glass
  float air_limit = 0;                    // as `limit`, in air

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
    float a = px / pz, b = py / pz, r2 = a * a + b * b;
    if (!(r2 < limit)) return {};
    if (ported && !throughPort(1.0F / pz, a, b, r2)) return {};
    const float radial = 1.0F + r2 * (k1 + r2 * (k2 + r2 * k3));
    const float u = fx * (a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a)) + cx;
    const float v = fy * (b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b) + cy;
    return {u, v, pz, true};
  }
  // From (a, b) of a point in water at this inverse depth, r2 = a2 + b2, to those of its light in the lens.
  // Snell's law, by iteration over the offset of the light in glass and air: the third step is accurate to a
  // thousandth of a pixel. False outside the lens's view.
  bool throughPort(float inverse, float& a, float& b, float& r2) const {
    // (a, b) times the ratio of tangents in air and in water is the light's slope in air.
    float slope = 1, ratio = 1;  // of the light in water over (a, b); of the light in air over that
    const float whole = 1.0F / (1.0F - (gap + glass) * inverse);
    for (int step = 0; step < 3; ++step) {
      const float t2 = r2 * slope * slope, less = 1.0F - bend_water * t2;
      ratio = index_water / std::sqrt(less > kGrazing ? less : kGrazing);
      // sin2 in glass = sin2 in water (water over glass)2; tan2 = sin2 / (1 - sin2).
      const float sine2 = slow_glass * slow_glass * t2 / (1.0F + t2);
      const float in_glass = slow_glass / std::sqrt((1.0F + t2) * (1.0F - sine2));
      if (step < 2) slope = whole / (1.0F + whole * inverse * (gap * ratio + glass * in_glass));
    }
    const float x = a * slope * ratio, y = b * slope * ratio;
    const auto& r = into_lens;
    const float lens_z = r[6] * x + r[7] * y + r[8];
    const float per_z = 1.0F / (lens_z > kGrazing ? lens_z : kGrazing);
    a = (r[0] * x + r[1] * y + r[2]) * per_z;
    b = (r[3] * x + r[4] * y + r[5]) * per_z;
    r2 = a * a + b * b;
    return (lens_z > kGrazing) & (r2 < air_limit);
  }
  static constexpr float kGrazing = 0.01F;
  // False only where no point of a sphere is in the image.
  [[nodiscard]] bool mayMeet(const Eigen::Vector3f& middle, float radius) const;
  [[nodiscard]] float depthOf(const Eigen::Vector3f& p) const {
    return rotation[6] * p.x() + rotation[7] * p.y() + rotation[8] * p.z() + translation[2];
  }

 private:
  void takePort(const FlatPort& port, const Eigen::Matrix3d& R_port_cam);
};

}  // namespace fathom::surface
