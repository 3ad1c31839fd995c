#include "telemetry/wire/frame.hpp"

#include <algorithm>

#include "realtime/kernel/crc32.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::size_t kHeaderBytes = 6;
constexpr std::size_t kCrcBytes = 4;
static_assert(kHeaderBytes + kCrcBytes == kFrameOverhead);

constexpr unsigned kTurnBit = 8;
constexpr unsigned kTypeMask = 7;
static_assert(kMessageTypes == kTypeMask + 1);

bool isRead(std::uint8_t first_byte) {
  constexpr unsigned kRecorded = 2;
  const unsigned version = first_byte >> 4, type = first_byte & kTypeMask;
  return version == kProtocolVersion ||
         (version == kRecorded && type != static_cast<unsigned>(MessageType::kDownlink));
}

}  // namespace

const char* name(MessageType type) {
  switch (type) {
    case MessageType::kStatus:
      return "status";
    case MessageType::kTrack:
      return "track";
    case MessageType::kMissionInfo:
      return "mission-info";
    case MessageType::kMapPacket:
      return "map";
    case MessageType::kRepair:
      return "repair";
    case MessageType::kTileFragment:
      return "tile";
    case MessageType::kDownlink:
      return "downlink";
  }
  return "unknown";
}

const char* name(FrameVerdict verdict) {
  switch (verdict) {
    case FrameVerdict::kAccepted:
      return "accepted";
    case FrameVerdict::kTooShort:
      return "too-short";
    case FrameVerdict::kTooLong:
      return "too-long";
    case FrameVerdict::kBadCrc:
      return "bad-crc";
    case FrameVerdict::kVersion:
      return "other-version";
    case FrameVerdict::kType:
      return "unknown-type";
    case FrameVerdict::kForeign:
      return "foreign";
    case FrameVerdict::kDuplicate:
      return "duplicate";
    case FrameVerdict::kBadPayload:
      return "bad-payload";
  }
  return "unknown";
}

std::size_t encodeFrame(const FrameHeader& header, std::span<const std::uint8_t> payload,
                        std::span<std::uint8_t> out) {
  const std::size_t size = payload.size() + kFrameOverhead;
  if (size > kMaxFrameBytes || size > out.size()) return 0;
  out[0] = static_cast<std::uint8_t>(kProtocolVersion << 4 | (header.turn ? kTurnBit : 0U) |
                                     (static_cast<unsigned>(header.type) & kTypeMask));
  out[1] = header.identity.vehicle_id;
  out[2] = static_cast<std::uint8_t>(header.identity.dive_id >> 8);
  out[3] = static_cast<std::uint8_t>(header.identity.dive_id);
  out[4] = static_cast<std::uint8_t>(header.sequence >> 8);
  out[5] = static_cast<std::uint8_t>(header.sequence);
  std::copy(payload.begin(), payload.end(), out.begin() + kHeaderBytes);
  const std::uint32_t crc = crc32(out.first(size - kCrcBytes));
  for (std::size_t i = 0; i < kCrcBytes; ++i)
    out[size - kCrcBytes + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
  return size;
}

DecodedFrame decodeFrame(std::span<const std::uint8_t> bytes) {
  DecodedFrame frame;
  if (bytes.size() < kFrameOverhead) return frame;
  if (bytes.size() > kMaxFrameBytes) {
    frame.verdict = FrameVerdict::kTooLong;
    return frame;
  }
  std::uint32_t crc = 0;
  for (const std::uint8_t byte : bytes.last(kCrcBytes)) crc = crc << 8 | byte;
  if (crc != crc32(bytes.first(bytes.size() - kCrcBytes))) {
    frame.verdict = FrameVerdict::kBadCrc;
  } else if (!isRead(bytes[0])) {
    frame.verdict = FrameVerdict::kVersion;
  } else if ((bytes[0] & kTypeMask) == 0) {
    frame.verdict = FrameVerdict::kType;
  } else {
    frame.verdict = FrameVerdict::kAccepted;
    frame.header.type = static_cast<MessageType>(bytes[0] & kTypeMask);
    frame.header.turn = (bytes[0] & kTurnBit) != 0;
    frame.header.identity.vehicle_id = bytes[1];
    frame.header.identity.dive_id = static_cast<std::uint16_t>(bytes[2] << 8 | bytes[3]);
    frame.header.sequence = static_cast<std::uint16_t>(bytes[4] << 8 | bytes[5]);
    frame.payload = bytes.subspan(kHeaderBytes, bytes.size() - kFrameOverhead);
  }
  return frame;
}

}  // namespace fathom::telemetry
