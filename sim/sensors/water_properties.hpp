#pragma once

namespace fathom::sim {

// Speed of sound in sea water [m/s]: Mackenzie (1981), for 2 to 30 deg C, 25 to 40 psu, down to 8,000 m.
[[nodiscard]] double soundSpeed(double temperature_c, double salinity_psu, double depth_m);
// Conductivity [S/m] of sea water of a practical salinity at atmospheric pressure: the practical salinity
// scale of 1978 (UNESCO technical paper 44), solved for conductivity. The effect of pressure is below 0.05 %
// at 50 m.
[[nodiscard]] double conductivity(double temperature_c, double salinity_psu);
// Practical salinity [psu] from conductivity [S/m].
[[nodiscard]] double practicalSalinity(double temperature_c, double conductivity_s_per_m);

}  // namespace fathom::sim
