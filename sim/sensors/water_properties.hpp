#pragma once

#include "recon/geometry/sea_water.hpp"  // soundSpeed

namespace fathom::sim {

// Conductivity [S/m] of sea water of a practical salinity at atmospheric pressure: the practical salinity
// scale of 1978 (UNESCO technical paper 44), solved for conductivity. The effect of pressure is below 0.05 %
// at 50 m.
[[nodiscard]] double conductivity(double temperature_c, double salinity_psu);
// Practical salinity [psu] from conductivity [S/m].
[[nodiscard]] double practicalSalinity(double temperature_c, double conductivity_s_per_m);

}  // namespace fathom::sim
