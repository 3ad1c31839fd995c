#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "sim/sea/light/water_light.hpp"
#include "sim/sea/optics.hpp"

namespace fathom::sim {

// Sun and sky from above. Irradiance falls with depth as exp(-(a + b_b) z / mu), mu the cosine of the
// refracted sun (Gordon 1989); waves focus the sun into moving caustics on the seafloor.
class Daylight {
 public:
  Daylight(const DaylightConfig& config, const WaterConfig& water, double turbidity, double time_s);

  [[nodiscard]] bool on() const { return config_.irradiance > 0; }
  // Unit, from the ground to the sun under water; nav, z down.
  [[nodiscard]] const Eigen::Vector3f& toSun() const { return to_sun_; }
  // Of a surface at a depth [m] and place in plan [m] with this normal; `sunlit`: not in shadow.
  [[nodiscard]] Radiance irradiance(float depth_m, const Eigen::Vector3f& place,
                                    const Eigen::Vector3f& normal, bool sunlit) const;
  // Radiance scattered by the water into a view ray of this length from a camera at this depth; `down`:
  // cosine between the ray and the vertical.
  [[nodiscard]] Radiance veil(float camera_depth_m, float down, float range_m) const;

 private:
  [[nodiscard]] Radiance level(float depth_m) const;
  [[nodiscard]] float caustic(const Eigen::Vector3f& place) const;

  DaylightConfig config_;
  Eigen::Vector3f to_sun_;
  Radiance diffuse_{}, beam_{}, back_{};  // attenuation of daylight and of a ray, what is thrown back [1/m]
  double time_s_;
};

}  // namespace fathom::sim
