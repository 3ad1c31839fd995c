#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::sim {

// Encodes a DVL sample as a PD0 ensemble (Teledyne RDI, "WorkHorse Commands and Output Data Format", P/N
// 957-6156) with fixed leader, variable leader and bottom track, the inverse of firmware_if/devices/dvl: the
// bottom's velocity in the ship frame (starboard, forward, mast).
//
// The format rounds velocity to 1 mm/s, ranges to 1 cm, speed of sound to 1 m/s and the time to 10 ms.
// Velocities beyond 32.767 m/s are sent as bad.
constexpr std::size_t kPd0FirstBlock = 6 + 2 * 3;  // after header and offsets
// Header, offsets, three blocks, reserve, checksum.
constexpr std::size_t kPd0EncodedBytes = kPd0FirstBlock + 59 + 65 + 81 + 2 + 2;

struct Pd0Attitude {
  double heading = 0;  // [rad]
  double pitch = 0;    // of the vehicle, bow up positive [rad]
  double roll = 0;     // starboard down positive [rad]
};

// `number`: 24 bits of it are sent. Absent ranges stay absent; the receiver derives the altitude from the
// ranges.
[[nodiscard]] std::array<std::uint8_t, kPd0EncodedBytes> encodePd0(const DvlSample& sample,
                                                                   std::uint32_t number,
                                                                   const Pd0Attitude& attitude);

// The time rounded to the resolution of an ensemble, 10 ms.
[[nodiscard]] std::int64_t roundToPd0Clock(std::int64_t utc_ns);

}  // namespace fathom::sim
