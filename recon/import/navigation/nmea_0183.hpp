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

}  // namespace fathom::topside
