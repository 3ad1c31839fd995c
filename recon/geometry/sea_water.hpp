#pragma once

namespace fathom {

// Depth below the surface [m] from the pressure of the water above [Pa] (0 at the surface) in an ocean of
// 35 psu and 0 deg C, at a latitude [rad]: Saunders and Fofonoff (1976) as in UNESCO technical papers in
// marine science 44 (1983), section 4. Check value there: 9712.653 m for 10,000 dbar at 30 degrees.
[[nodiscard]] double depthFromPressure(double pressure_pa, double latitude) noexcept;

// The same in water of one density [kg/m3], for lakes and estuaries; gravity at the surface as in the above.
[[nodiscard]] double depthFromPressure(double pressure_pa, double latitude, double density) noexcept;

// Speed of sound in sea water [m/s] from temperature [deg C], salinity [psu] and depth [m]: Mackenzie (1981),
// standard error 0.07 m/s. Only within the bounds below.
[[nodiscard]] double soundSpeed(double temperature_c, double salinity_psu, double depth_m) noexcept;
[[nodiscard]] bool soundSpeedIsKnown(double temperature_c, double salinity_psu, double depth_m) noexcept;

// Practical salinity from conductivity [S/m], temperature [deg C, ITS-90] and the pressure of the water above
// [Pa]: PSS-78 as in UNESCO technical papers in marine science 44 (1983), section 2. NaN outside of 2 to 42,
// -2 to 35 deg C, where it does not hold.
[[nodiscard]] double practicalSalinity(double conductivity, double temperature_c,
                                       double pressure_pa) noexcept;

}  // namespace fathom
