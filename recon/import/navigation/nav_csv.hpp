#pragma once

#include "recon/import/navigation/nav_data.hpp"

namespace fathom::topside {

// A table of navigation. `options.columns`: QUANTITY=COLUMN[:UNIT], with commas between, such as
// "time=t:ms,depth=z,heading=yaw:rad"; other columns are known by their usual names, with units in them or
// [m], [deg], [m/s]. Quantities: time (and date), latitude, longitude, latitude_sign and longitude_sign (N,
// S, E, W), north, east, sigma, depth, height, heading, roll, pitch, altitude, forward, starboard, down,
// velocity_north, velocity_east, velocity_down. Empty cells and NaN are not there. Latitudes and longitudes
// may be degrees and minutes, with a letter. Depths that are mostly negative are taken for heights. Throws
// InputError, which names the row.
[[nodiscard]] NavData readNavCsv(const std::filesystem::path& path, const NavFileOptions& options);

}  // namespace fathom::topside
