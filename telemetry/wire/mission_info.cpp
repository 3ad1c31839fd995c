#include "telemetry/wire/mission_info.hpp"

#include <algorithm>

#include "realtime/base/units.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/wire/status.hpp"

namespace fathom::telemetry {
namespace {

constexpr Field kLatitude{-90, 90, 1e-7};     // [deg]
constexpr Field kLongitude{-180, 180, 1e-7};  // [deg]
constexpr unsigned kHashBits = 16;
constexpr unsigned kLengthBits = 5;
constexpr unsigned kCharacterBits = 7;  // ASCII
static_assert(kMaxNameBytes < 1U << kLengthBits);

constexpr bool printable(char c) {
  return c >= ' ' && c <= '~';
}

constexpr std::uint32_t hashSchema() {
  std::uint32_t hash = 2166136261U;  // FNV offset basis
  using namespace schema;
  for (const Field& field : {kTime, kHorizontal, kDepth, kStatusTime, kStatusHorizontal, kStatusDepth, kTilt,
                             kHeading, kAltitude, kSpeed, kBattery, kProgress, kLatitude, kLongitude})
    hash = hashField(hash, field);
  for (const LogField& field : {kPositionSigma, kArea, kPairs, kDropped, kLateCycles, kShed, kRefusals})
    hash = hashField(hash, field);
  return (hash ^ kMapPacketFormat) * 16777619U;  // FNV prime
}

}  // namespace

std::uint16_t schemaHash() {
  constexpr std::uint32_t kHash = hashSchema();
  return static_cast<std::uint16_t>(kHash ^ kHash >> 16);
}

std::size_t encodeMissionInfo(const MissionInfo& info, std::span<std::uint8_t> out) {
  BitWriter w(out);
  w.put(schemaHash(), kHashBits);
  w.put(kLatitude, info.origin.latitude / kRadiansPerDegree);
  w.put(kLongitude, info.origin.longitude / kRadiansPerDegree);
  w.put(timeToLink(info.start_utc_ns), schema::kTime.bits());
  if (!w.ok() || w.bitsLeft() < kLengthBits) return 0;
  const std::size_t room = (w.bitsLeft() - kLengthBits) / kCharacterBits;
  const std::size_t length = std::min({info.vehicle_name.size(), kMaxNameBytes, room});
  w.put(length, kLengthBits);
  for (std::size_t i = 0; i < length; ++i) {
    const char c = info.vehicle_name[i];
    w.put(static_cast<std::uint64_t>(printable(c) ? c : '?'), kCharacterBits);
  }
  return w.ok() ? w.bytes() : 0;
}

bool decodeMissionInfo(std::span<const std::uint8_t> payload, MissionInfo& info) {
  MissionInfo decoded;
  BitReader r(payload);
  decoded.schema_hash = static_cast<std::uint16_t>(r.get(kHashBits));
  decoded.origin.latitude = r.get(kLatitude) * kRadiansPerDegree;
  decoded.origin.longitude = r.get(kLongitude) * kRadiansPerDegree;
  decoded.start_utc_ns = timeFromLink(r.get(schema::kTime.bits()));
  const std::size_t length = r.get(kLengthBits);
  for (std::size_t i = 0; i < length && r.ok(); ++i) {
    const char c = static_cast<char>(r.get(kCharacterBits));
    if (!printable(c)) return false;
    decoded.vehicle_name.push_back(c);
  }
  if (!r.ok() || !r.finished()) return false;
  info = decoded;
  return true;
}

}  // namespace fathom::telemetry
