#include "sim/sea/light/marine_snow.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/scenario/random.hpp"
#include "sim/sea/light/lens.hpp"

namespace fathom::sim {
namespace {

constexpr double kSmallest = 0.0005;                 // least diameter counted by the density [m]
constexpr double kNearestSpeck = 0.1, kReach = 5.0;  // [m]
constexpr double kWider = 1.25;  // over the left camera's view, to contain the right one's

}  // namespace

std::vector<Speck> marineSnow(const WaterConfig& water, const Camera& left, std::uint64_t seed) {
  std::vector<Speck> specks;
  if (water.snow_per_m3 <= 0) return specks;
  const double half_x = kWider * 0.5 * left.width / left.fx, half_y = kWider * 0.5 * left.height / left.fy;
  const double volume = 4 * half_x * half_y * (std::pow(kReach, 3) - std::pow(kNearestSpeck, 3)) / 3;
  Random random(seed);
  const double mean = volume * water.snow_per_m3;
  const auto count =
      static_cast<std::size_t>(std::max(0.0, std::round(mean + random.gauss(std::sqrt(mean)))));
  const double power = 1 - water.snow_slope;
  const double low = std::pow(kSmallest, power), high = std::pow(0.001 * water.snow_largest_mm, power);
  for (std::size_t k = 0; k < count; ++k) {
    const double z = std::cbrt(random.uniform(std::pow(kNearestSpeck, 3), std::pow(kReach, 3)));
    const double x = random.uniform(-half_x, half_x) * z, y = random.uniform(-half_y, half_y) * z;
    const double diameter = std::pow(random.uniform(high, low), 1 / power);
    specks.push_back({Eigen::Vector3d(x, y, z).cast<float>(), static_cast<float>(diameter)});
  }
  return specks;
}

std::vector<VisibleSpeck> visibleSpecks(const std::vector<Speck>& specks, const OpticsConfig& lamps,
                                        const WaterAttenuation& attenuation, const std::vector<Beam>& beams,
                                        const Camera& camera, const SE3& T_body_cam, const SE3& T_body_left) {
  constexpr double kSphere = 0.5;  // reflection of a sphere over that of a plate facing the lamp
  const double given = kSphere * lamps.water.snow_albedo / std::numbers::pi;
  const SE3 T_cam_left = T_body_cam.inverse() * T_body_left;
  const double focal = 0.5 * (camera.fx + camera.fy);
  std::vector<VisibleSpeck> out;
  for (const Speck& speck : specks) {
    const Eigen::Vector3d p = T_cam_left * speck.position.cast<double>();
    if (p.z() <= 0) continue;
    const Eigen::Vector2d pixel = camera.project(p);
    const double range = p.norm();
    const double disc = static_cast<double>(speck.diameter) * focal / p.z();
    const auto out_of_focus = static_cast<double>(discAcross(
        static_cast<float>(1 / range), 0.001 * lamps.sensor.aperture_mm * focal, lamps.sensor.focus_m));
    const double across = std::max(1.0, std::hypot(disc, out_of_focus));
    if (!camera.contains(pixel, -0.5 * across)) continue;
    VisibleSpeck seen{static_cast<float>(pixel.x()),
                      static_cast<float>(pixel.y()),
                      static_cast<float>(range),
                      static_cast<float>(0.5 * across),
                      static_cast<float>(disc * disc / (across * across)),
                      {}};
    const Eigen::Vector3d in_body = T_body_cam * p;
    for (std::size_t s = 0; s < lamps.strobes.size(); ++s) {
      const StrobeIncidence shine(lamps.strobes[s], beams[s], in_body);
      const Radiance left = attenuation(static_cast<float>(shine.distance + range));
      for (std::size_t c = 0; c < 3; ++c)
        seen.radiance[c] +=
            static_cast<float>(given / (shine.distance * shine.distance)) * shine.intensity * left[c];
    }
    out.push_back(seen);
  }
  return out;
}

void drawSpecks(const std::vector<VisibleSpeck>& specks, const std::vector<float>& inverse_range, int width,
                int height, int channels, const Channels& mono, std::vector<float>& radiance) {
  const double weight = mono[0] + mono[1] + mono[2];
  for (const VisibleSpeck& s : specks) {
    const float reach = s.radius + 1;
    const int x0 = std::max(0, static_cast<int>(s.x - reach)),
              x1 = std::min(width - 1, static_cast<int>(s.x + reach) + 1);
    const int y0 = std::max(0, static_cast<int>(s.y - reach)),
              y1 = std::min(height - 1, static_cast<int>(s.y + reach) + 1);
    double gray = 0;
    for (std::size_t c = 0; c < 3; ++c) gray += mono[c] * static_cast<double>(s.radiance[c]) / weight;
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const auto pixel =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
        if (inverse_range[pixel] * s.range > 1) continue;  // behind the ground
        const float distance = std::hypot(static_cast<float>(x) - s.x, static_cast<float>(y) - s.y);
        const float cover = s.cover * std::clamp(s.radius + 0.5F - distance, 0.0F, 1.0F);
        if (cover <= 0) continue;
        float* value = &radiance[pixel * static_cast<std::size_t>(channels)];
        for (int c = 0; c < channels; ++c) {
          const float own =
              channels == 1 ? static_cast<float>(gray) : s.radiance[static_cast<std::size_t>(c)];
          value[c] += cover * (own - value[c]);
        }
      }
    }
  }
}

}  // namespace fathom::sim
