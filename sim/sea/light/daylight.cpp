#include "sim/sea/light/daylight.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/sea/ground/noise.hpp"

namespace fathom::sim {
namespace {

constexpr double kWaterIndex = 1.34;
constexpr std::uint64_t kWaves = 77;  // of the caustics' noise

// Ridged noise: bright lines about dark cells; these constants normalise it to zero mean and unit variance
// for noise with a standard deviation of 0.25.
constexpr double kSharpness = 12, kMean = 0.2187, kSigma = 0.2615;

}  // namespace

Daylight::Daylight(const DaylightConfig& config, const WaterConfig& water, double turbidity, double time_s)
    : config_(config), time_s_(time_s) {
  const double flat = std::cos(config.sun_elevation_rad) / kWaterIndex, up = std::sqrt(1 - flat * flat);
  to_sun_ =
      Eigen::Vector3d(flat * std::cos(config.sun_azimuth_rad), flat * std::sin(config.sun_azimuth_rad), -up)
          .cast<float>();
  for (std::size_t c = 0; c < 3; ++c) {
    const double scattering = turbidity * water.scattering_per_m[c],
                 back = scattering * water.backscatter_fraction;
    diffuse_[c] = static_cast<float>((water.absorption_per_m[c] + back) / up);
    beam_[c] = static_cast<float>(water.absorption_per_m[c] + scattering);
    back_[c] = static_cast<float>(back / (2 * std::numbers::pi));
  }
}

Radiance Daylight::level(float depth_m) const {
  Radiance out{};
  for (std::size_t c = 0; c < 3; ++c)
    out[c] = static_cast<float>(config_.irradiance) * std::exp(-diffuse_[c] * std::max(0.0F, depth_m));
  return out;
}

float Daylight::caustic(const Eigen::Vector3f& place) const {
  if (config_.caustics <= 0) return 1;
  // The pattern is constant along the sun's rays: evaluated at the surface.
  const Eigen::Vector3f from = place - to_sun_ * (place.z() / to_sun_.z());
  const double size = config_.caustic_size_m;
  const double noise =
      gradientNoise(kWaves, static_cast<double>(from.x()) / size, static_cast<double>(from.y()) / size,
                    time_s_ / config_.caustic_period_s);
  const double ridge = (std::exp(-kSharpness * std::abs(noise)) - kMean) / kSigma;
  return static_cast<float>(std::max(0.0, 1 + config_.caustics * ridge));
}

Radiance Daylight::irradiance(float depth_m, const Eigen::Vector3f& place, const Eigen::Vector3f& normal,
                              bool sunlit) const {
  const auto share = static_cast<float>(config_.sun_share);
  float part = (1 - share) * 0.5F * (1 - normal.z());
  if (sunlit) part += share * std::max(0.0F, normal.dot(to_sun_)) / -to_sun_.z() * caustic(place);
  Radiance out = level(depth_m);
  for (float& e : out) e *= part;
  return out;
}

Radiance Daylight::veil(float camera_depth_m, float down, float range_m) const {
  Radiance out = level(camera_depth_m);
  for (std::size_t c = 0; c < 3; ++c) {
    const float rate = std::max(1e-4F, beam_[c] + diffuse_[c] * down);
    out[c] *= back_[c] * (1 - std::exp(-rate * range_m)) / rate;
  }
  return out;
}

}  // namespace fathom::sim
