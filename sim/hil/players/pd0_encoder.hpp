#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::sim {

// A DVL sample as the PD0 ensemble that an instrument would send (Teledyne RDI, "WorkHorse Commands and
// Output Data Format", P/N 957-6156): fixed leader, variable leader, bottom track. The inverse of
// firmware_if/dvl: ship frame (starboard, forward, mast), the bottom's velocity.
//
// What the format cannot carry is rounded: velocity to 1 mm/s, ranges to 1 cm, speed of sound to 1 m/s, the
// time to 10 ms (so the ensemble is best sent for the nearest such moment). Velocities beyond 32.767 m/s are
// sent as bad.
constexpr std::size_t kPd0FirstBlock = 6 + 2 * 3;  // behind header and offsets
// Header, offsets, three blocks, reserve, checksum.
constexpr std::size_t kPd0EncodedBytes = kPd0FirstBlock + 59 + 65 + 81 + 2 + 2;

struct Pd0Attitude {
  double heading = 0;  // [rad]
  double pitch = 0;    // of the vehicle, bow up positive [rad]
  double roll = 0;     // starboard down positive [rad]
};

// `number`: 24 bits of it are sent. The ensemble's ranges give the altitude: those that are absent stay so.
[[nodiscard]] std::array<std::uint8_t, kPd0EncodedBytes> encodePd0(const DvlSample& sample,
                                                                   std::uint32_t number,
                                                                   const Pd0Attitude& attitude);

// The sample's time as an ensemble tells it: the nearest hundredth of a second.
[[nodiscard]] std::int64_t roundToPd0Clock(std::int64_t utc_ns);

}  // namespace fathom::sim
