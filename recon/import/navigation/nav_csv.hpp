#pragma once

#include "recon/import/navigation/nav_data.hpp"

namespace fathom::topside {

// A log of NMEA 0183 sentences, as a ship's or an ROV's logger writes it, with or without its own time at
// the head of each line: GGA, GLL, RMC, ZDA; HDT, THS, HDG, HDM; VTG, VBW; DBT and DPT, taken for the height
// over the seafloor; XDR (pitch, roll, depth); PASHR, PRDID, PSXN,23. Sentences without a time are as old as
// the newest time before them. Lines with a wrong checksum are left out and counted. Throws InputError where
// no time can be found.
[[nodiscard]] NavData readNmea(const std::filesystem::path& path, double declination,
                               std::optional<std::int64_t> about_utc_ns);

// A table of navigation. `options.columns`: QUANTITY=COLUMN[:UNIT], with commas between, such as
// "time=t:ms,depth=z,heading=yaw:rad"; other columns are known by their usual names, with units in them or
// [m], [deg], [m/s]. Quantities: time (and date), latitude, longitude, latitude_sign and longitude_sign (N,
// S, E, W), north, east, sigma, depth, height, heading, roll, pitch, altitude, forward, starboard, down,
// velocity_north, velocity_east, velocity_down. Empty cells and NaN are not there. Latitudes and longitudes
// may be degrees and minutes, with a letter. Depths that are mostly negative are taken for heights. Throws
// InputError, which names the row.
[[nodiscard]] NavData readNavCsv(const std::filesystem::path& path, const NavFileOptions& options);

}  // namespace fathom::topside
