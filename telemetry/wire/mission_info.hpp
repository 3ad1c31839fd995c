#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "recon/geometry/geodesy.hpp"
#include "telemetry/wire/field.hpp"

namespace fathom::telemetry {

// What a receiver needs to place the map on the Earth; sent seldom, and repeatedly.
struct MissionInfo {
  std::string vehicle_name;  // printable ASCII; as much of it as fits a frame is sent, at most kMaxNameBytes
  Geodetic origin;           // of nav [rad], sent to 1e-7 deg (1.1 cm)
  std::int64_t start_utc_ns = 0;  // sent to 0.1 s
  std::uint16_t schema_hash = 0;  // set by decodeMissionInfo: the sender's; compare with schemaHash()
};
inline constexpr std::size_t kMaxNameBytes = 31;

// Hash of every field's bounds and resolution in this protocol version.
[[nodiscard]] std::uint16_t schemaHash();

[[nodiscard]] std::size_t encodeMissionInfo(const MissionInfo& info, std::span<std::uint8_t> out);
[[nodiscard]] bool decodeMissionInfo(std::span<const std::uint8_t> payload, MissionInfo& info);

}  // namespace fathom::telemetry
