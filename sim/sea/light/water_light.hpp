#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/sea/optics.hpp"

namespace fathom::sim {

using Radiance = std::array<float, 3>;

// Transmission of each channel over a path through water, from a table.
class WaterAttenuation {
 public:
  explicit WaterAttenuation(const WaterConfig& water);
  [[nodiscard]] Radiance operator()(float path_m) const;

 private:
  std::vector<Radiance> table_;
};

// A strobe's intensity off its axis: cos^n, one half at the half angle.
class Beam {
 public:
  explicit Beam(const StrobeConfig& strobe);
  [[nodiscard]] float operator()(float cos_off_axis) const;

 private:
  std::vector<float> table_;
};

// Incidence of a strobe's light at a place in body.
struct StrobeIncidence {
  StrobeIncidence(const StrobeConfig& strobe, const Beam& beam, const Eigen::Vector3d& place)
      : from(place - strobe.position_body),
        distance(from.norm()),
        intensity(beam(static_cast<float>(from.dot(strobe.direction_body.normalized()) / distance))) {}
  Eigen::Vector3d from;  // from the strobe to the place [m]
  double distance;       // [m]
  float intensity;       // in that direction
};

// Backscattered light along the view rays of one camera, without shadows in the water. Strobes and camera are
// rigidly mounted, so it is a table over the image and the length of the view ray:
//   B(r) = integral over t in 0..r of sum_s I_s(theta_s) / d_s^2 * exp(-c (d_s + t)) * beta dt,
//   beta = scattering * backscatter_fraction / (2 pi)
class Backscatter {
 public:
  Backscatter(const OpticsConfig& optics, const WaterAttenuation& attenuation, const std::vector<Beam>& beams,
              const Camera& camera, const SE3& T_body_cam);
  [[nodiscard]] Radiance at(float x_px, float y_px, float range_m) const;

 private:
  [[nodiscard]] const Radiance& entry(int column, int row, int step) const;

  float cells_per_px_x_, cells_per_px_y_;
  std::vector<Radiance> table_;
};

}  // namespace fathom::sim
