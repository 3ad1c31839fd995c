#pragma once

#include <cstdint>
#include <optional>

namespace fathom::io {

// What Fathom knows and tells other equipment on the bus. Trivially copyable, so that it crosses threads in a
// latest-value slot.
struct VehicleReport {
  std::int64_t utc_ns = 0;                 // at which it was true
  std::optional<double> latitude;          // of the vehicle, estimated [rad]
  std::optional<double> longitude;         // [rad]
  std::optional<double> sigma_horizontal;  // of either horizontal component [m]
  std::optional<double> depth;             // of the vehicle below the surface [m]
  std::optional<double> altitude;          // above the seafloor [m]
  double map_area = 0;                     // seafloor mapped [m2]
  std::uint32_t pairs_mapped = 0;          // stereo pairs in the map
  std::uint32_t pairs_dropped = 0;         // stereo pairs that gave the map nothing
  std::uint16_t health = 0;                // flags as in the modem's status (telemetry/wire/status.hpp)
  std::optional<double> mission_progress;  // 0 to 1
};

}  // namespace fathom::io
