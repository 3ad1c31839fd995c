#include "telemetry/wire/frame.hpp"

#include <algorithm>
#include <array>

#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/units.hpp"
#include "telemetry/wire/status.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::size_t kHeaderBytes = 6;
constexpr std::size_t kTagBytes = 4;
static_assert(kHeaderBytes + kTagBytes == kFrameOverhead);

constexpr unsigned kTurnBit = 8;
constexpr unsigned kTypeMask = 7;
static_assert(kMessageTypes == kTypeMask + 1);

// Whether a frame ends with a CRC-32: those of protocol 3, and of 2 but for the downlink.
bool hasCrc(std::uint8_t first_byte) {
  const unsigned version = first_byte >> 4, type = first_byte & kTypeMask;
  return version == 3 || (version == 2 && type != static_cast<unsigned>(MessageType::kDownlink));
}

std::uint32_t lastFour(std::span<const std::uint8_t> bytes) {
  std::uint32_t number = 0;
  for (const std::uint8_t byte : bytes.last(kTagBytes)) number = number << 8 | byte;
  return number;
}

// Mask of the tag's bits that the frame alone determines.
std::uint32_t ownBits(std::span<const std::uint8_t> bytes) {
  return (bytes[0] & kTypeMask) == static_cast<unsigned>(MessageType::kRepair) ? 0xFFFFFF00U : 0xFFFFFFFFU;
}

}  // namespace

const char* name(MessageType type) {
  static constexpr std::array kNames{"report", "status", "track", "mission-info",
                                     "map",    "repair", "tile",  "downlink"};
  const auto at = static_cast<std::size_t>(type);
  return at < kNames.size() ? kNames[at] : "unknown";
}

const char* name(FrameVerdict verdict) {
  static constexpr std::array kNames{"accepted",      "too-short",    "too-long", "bad-tag",
                                     "other-version", "unknown-type", "foreign",  "duplicate",
                                     "bad-payload",   "unkeyed",      "old"};
  const auto at = static_cast<std::size_t>(verdict);
  return at < kNames.size() ? kNames[at] : "unknown";
}

Version firstVersion(std::int64_t start_utc_ns) {
  constexpr std::int64_t kLap_ns = 7200 * kSecond_ns;
  constexpr std::int64_t kEpoch_ns = schema::kTimeEpoch_s * kSecond_ns;
  const std::int64_t since_ns = start_utc_ns - kEpoch_ns;
  const std::int64_t laps = since_ns / kLap_ns + (since_ns % kLap_ns < 0 ? 0 : 1);
  // No version is 0.
  return static_cast<Version>(std::max<std::uint16_t>(1, static_cast<std::uint16_t>(laps))) << 16;
}

std::size_t encodeFrame(const FrameHeader& header, std::span<const std::uint8_t> payload,
                        std::span<std::uint8_t> out, const FrameTag& tag, std::uint8_t group) {
  const std::size_t size = payload.size() + kFrameOverhead;
  if (size > kMaxFrameBytes || size > out.size()) return 0;
  out[0] = static_cast<std::uint8_t>(kProtocolVersion << 4 | (header.turn ? kTurnBit : 0U) |
                                     (static_cast<unsigned>(header.type) & kTypeMask));
  out[1] = header.identity.vehicle_id;
  out[2] = static_cast<std::uint8_t>(header.identity.dive_id >> 8);
  out[3] = static_cast<std::uint8_t>(header.identity.dive_id);
  out[4] = static_cast<std::uint8_t>(header.sequence() >> 8);
  out[5] = static_cast<std::uint8_t>(header.sequence());
  std::copy(payload.begin(), payload.end(), out.begin() + kHeaderBytes);
  const std::uint32_t last = tag.of(out.first(size - kTagBytes), lapOf(header.version)) ^ group;
  for (std::size_t i = 0; i < kTagBytes; ++i)
    out[size - kTagBytes + i] = static_cast<std::uint8_t>(last >> (24 - 8 * i));
  return size;
}

DecodedFrame peekFrame(std::span<const std::uint8_t> bytes) {
  DecodedFrame frame;
  if (bytes.size() < kFrameOverhead) return frame;
  if (bytes.size() > kMaxFrameBytes) {
    frame.verdict = FrameVerdict::kTooLong;
  } else if (bytes[0] >> 4 != kProtocolVersion && !hasCrc(bytes[0])) {
    frame.verdict = FrameVerdict::kVersion;
  } else {
    frame.header.type = static_cast<MessageType>(bytes[0] & kTypeMask);
    frame.header.turn = (bytes[0] & kTurnBit) != 0;
    frame.header.identity.vehicle_id = bytes[1];
    frame.header.identity.dive_id = static_cast<std::uint16_t>(bytes[2] << 8 | bytes[3]);
    frame.header.version = static_cast<Version>(bytes[4] << 8 | bytes[5]);
    frame.payload = bytes.subspan(kHeaderBytes, bytes.size() - kFrameOverhead);
    frame.verdict = FrameVerdict::kAccepted;
  }
  return frame;
}

DecodedFrame decodeFrame(std::span<const std::uint8_t> bytes, const FrameTag& tag,
                         std::span<const std::uint16_t> laps) {
  DecodedFrame frame = peekFrame(bytes);
  if (frame.verdict != FrameVerdict::kAccepted && frame.verdict != FrameVerdict::kVersion) return frame;
  const auto checked = bytes.first(bytes.size() - kTagBytes);
  const std::uint32_t last = lastFour(bytes);
  const bool has_crc = hasCrc(bytes[0]);
  const std::uint32_t own = has_crc ? 0xFFFFFFFFU : ownBits(bytes);
  const auto fits = [&](std::uint32_t right) { return ((last ^ right) & own) == 0; };
  const std::uint32_t unkeyed = has_crc ? crc32(checked) : FrameTag().of(checked, 0);
  if (frame.verdict == FrameVerdict::kVersion) {  // reported only of whole frames
    if (!fits(crc32(checked)) && !fits(unkeyed)) frame.verdict = FrameVerdict::kBadTag;
    return frame;
  }
  frame.verdict = FrameVerdict::kBadTag;
  if (!tag.keyed() || has_crc) {
    if (!fits(unkeyed)) return frame;
    frame.verdict = tag.keyed() ? FrameVerdict::kUnkeyed : FrameVerdict::kAccepted;
    if (!has_crc) frame.group = static_cast<std::uint8_t>(last ^ unkeyed);
  } else {
    for (const std::uint16_t lap : laps) {
      const std::uint32_t right = tag.of(checked, lap);
      if (!fits(right)) continue;
      frame.verdict = FrameVerdict::kAccepted;
      frame.whole_version = true;
      frame.header.version |= static_cast<Version>(lap) << 16;
      frame.group = static_cast<std::uint8_t>(last ^ right);
      break;
    }
    if (frame.verdict == FrameVerdict::kBadTag && fits(unkeyed)) frame.verdict = FrameVerdict::kUnkeyed;
  }
  return frame;
}

}  // namespace fathom::telemetry
