#pragma once

#include <cstdint>
#include <cstring>
#include <string>

#include "telemetry/monitor/map/surface.hpp"

namespace fathom::monitor {

inline constexpr std::size_t kMaxStreamBytes =
    1 << 20;  // then the next call continues, so that a page stays responsive

// The chunks that changed after version `since`, oldest change first, for the page (decoded by
// page/src/chunks.ts). Little-endian: "FMAP", u32 map version of the reader after taking this (less than the
// store's if kMaxStreamBytes cut it short), u32 number of chunks, u32 0, f64 UTC [s] that times are counted
// from; then for each chunk i32 north and i32 east index, u32 vertices, u32 triangles, f32 area [m2], u32 0;
// and row after row, each padded to four bytes,
//   u16 north, u16 east of every vertex, in units of 1/128 m from the chunk's corner
//   f32 depth [m]
//   i8 normal north, east, up (127: 1), u8 spacing code
//   u8 red, green, blue, flags (1: has colour, 2: interpolated)
//   u16 sigma [mm], u16 error bound [mm]
//   f32 received, f32 changed [s since the time above; changed: NaN for never]
//   three indices a triangle: u16, or u32 in chunks of more than 65,535 vertices.
[[nodiscard]] std::string mapBinary(const BlockStore& store, Surface& surface, std::uint64_t since,
                                    std::int64_t base_utc_ns);

// Appends a number as it is in memory: the machines this runs on are little-endian, as are the formats.
template <class T>
void appendBytes(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}

}  // namespace fathom::monitor
