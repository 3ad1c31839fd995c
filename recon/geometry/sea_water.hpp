#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace fathom {

// Depth below the surface [m] from the pressure of the water above [Pa] (0 at the surface) in an ocean of
// 35 psu and 0 deg C, at a latitude [rad]: Saunders and Fofonoff (1976) as in UNESCO technical papers in
// marine science 44 (1983), section 4. Check value there: 9712.653 m for 10,000 dbar at 30 degrees.
[[nodiscard]] double depthFromPressure(double pressure_pa, double latitude) noexcept;

// The same in water of one density [kg/m3], for lakes and estuaries; gravity at the surface as in the above.
[[nodiscard]] double depthFromPressure(double pressure_pa, double latitude, double density) noexcept;

// Speed of sound in sea or fresh water [m/s] from temperature [deg C, ITS-90], salinity [psu] and the
// pressure of the water above [Pa]: Chen and Millero (1977) as in UNESCO technical papers in marine science
// 44 (1983), section 9. Check value there: 1731.995 m/s for 40 psu, 40 deg C (of 1968) and 10,000 dbar.
// Standard error 0.19 m/s. NaN outside of 0 to 40 psu, -2 to 40 deg C and 10,000 dbar: it was measured from 0
// deg C upwards and is extrapolated to the freezing point of sea water.
[[nodiscard]] double soundSpeedAtPressure(double temperature_c, double salinity_psu,
                                          double pressure_pa) noexcept;
// The same at a depth [m], at 45 degrees of latitude: at another one c differs by 0.05 m/s in 1,000 m.
[[nodiscard]] double soundSpeed(double temperature_c, double salinity_psu, double depth_m) noexcept;

// Practical salinity from conductivity [S/m], temperature [deg C, ITS-90] and the pressure of the water above
// [Pa]: PSS-78 as in UNESCO technical papers in marine science 44 (1983), section 2. NaN outside of 2 to 42,
// -2 to 35 deg C, the range of validity.
[[nodiscard]] double practicalSalinity(double conductivity, double temperature_c,
                                       double pressure_pa) noexcept;

// Predicted height of the sea surface over nav's zero, which adds to the depth of a pressure sensor:
//   h = amplitude sin(2 pi t / period + phase),   t since start_utc_ns.
struct Tide {
  double amplitude = 0, period = 1, phase = 0;  // [m], [s], [rad]
  std::int64_t start_utc_ns = 0;
  [[nodiscard]] double heightAt(std::int64_t utc_ns) const noexcept;  // [m]
};

// From tide_model of mission.toml: "none", or "sinusoid amplitude_m=A period_s=P phase_rad=F" from the
// mission's start on. std::nullopt for none. Throws InputError for any other text.
[[nodiscard]] std::optional<Tide> readTide(const std::string& tide_model, std::int64_t start_utc_ns);

}  // namespace fathom
