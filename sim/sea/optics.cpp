#include "sim/sea/optics.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

namespace fathom::sim {
namespace {

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(std::string("optics: ") + what);
}

bool within(const Channels& values, double low, double high) {
  for (double v : values)
    if (!(v >= low && v <= high)) return false;
  return true;
}

}  // namespace

void validate(const OpticsConfig& config) {
  constexpr std::size_t kMaxStrobes = 8;
  require(!config.strobes.empty() && config.strobes.size() <= kMaxStrobes, "there must be 1 to 8 strobes");
  for (const StrobeConfig& s : config.strobes) {
    require(s.position_body.allFinite() && s.direction_body.allFinite() && s.direction_body.norm() > 1e-6,
            "a strobe's position_body and direction_body must be finite, and the direction not zero");
    require(s.intensity >= 0 && s.intensity <= 1000, "a strobe's intensity must be 0 to 1000");
    require(s.half_angle_rad >= 0.05 && s.half_angle_rad <= 1.5,
            "a strobe's half_angle_rad must be 0.05 to 1.5");
  }
  require(within(config.water.absorption_per_m, 0, 10), "water.absorption_per_m must be 0 to 10");
  require(within(config.water.scattering_per_m, 0, 10), "water.scattering_per_m must be 0 to 10");
  require(config.water.backscatter_fraction >= 0 && config.water.backscatter_fraction <= 1,
          "water.backscatter_fraction must be 0 to 1");
  const SensorConfig& sensor = config.sensor;
  for (PixelFormat format : {sensor.left_format, sensor.right_format})
    require(format == PixelFormat::kMono || format == PixelFormat::kBayerRggb,
            "sensor formats are mono or Bayer RGGB");
  require(sensor.bits == 8 || sensor.bits == 12, "sensor.bits must be 8 or 12");
  require(within(sensor.quantum_efficiency, 0.001, 1), "sensor.quantum_efficiency must be 0.001 to 1");
  require(sensor.full_well_electrons >= 100 && sensor.full_well_electrons <= 1e6,
          "sensor.full_well_electrons must be 100 to 1000000");
  require(sensor.read_noise_electrons >= 0 && sensor.read_noise_electrons <= 1000,
          "sensor.read_noise_electrons must be 0 to 1000");
  require(sensor.black_level >= 0 && sensor.black_level <= 0.5, "sensor.black_level must be 0 to 0.5");
  require(sensor.vignetting_power >= 0 && sensor.vignetting_power <= 20,
          "sensor.vignetting_power must be 0 to 20");
  require(sensor.blur_sigma_px >= 0 && sensor.blur_sigma_px <= 5, "sensor.blur_sigma_px must be 0 to 5");
  require(sensor.exposure > 0 && sensor.exposure <= 1000, "sensor.exposure must be over 0, to 1000");
  require(sensor.exposure_distance_m >= 0.1 && sensor.exposure_distance_m <= 20,
          "sensor.exposure_distance_m must be 0.1 to 20");
  require(sensor.right_gain >= 0.05 && sensor.right_gain <= 20, "sensor.right_gain must be 0.05 to 20");
  require(config.flash_sigma >= 0 && config.flash_sigma <= 1, "flash_sigma must be 0 to 1");
  require(config.dark_probability >= 0 && config.dark_probability <= 1, "dark_probability must be 0 to 1");
  require(config.edge_samples == 1 || config.edge_samples == 4 || config.edge_samples == 8,
          "edge_samples must be 1, 4 or 8");
}

}  // namespace fathom::sim
