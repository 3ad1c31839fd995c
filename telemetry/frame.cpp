#include "telemetry/frame.hpp"

#include <algorithm>

#include "telemetry/crc32.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::size_t kHeaderBytes = 6;
constexpr std::size_t kCrcBytes = 4;
static_assert(kHeaderBytes + kCrcBytes == kFrameOverhead);

bool known(std::uint8_t type) {
  return type >= static_cast<std::uint8_t>(MessageType::kStatus) &&
         type <= static_cast<std::uint8_t>(MessageType::kTileFragment);
}

}  // namespace

const char* name(MessageType type) {
  switch (type) {
    case MessageType::kStatus:
      return "status";
    case MessageType::kStatusNavigation:
      return "status-navigation";
    case MessageType::kStatusHealth:
      return "status-health";
    case MessageType::kTrack:
      return "track";
    case MessageType::kMissionInfo:
      return "mission-info";
    case MessageType::kTileFragment:
      return "tile";
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
  out[0] = static_cast<std::uint8_t>(kProtocolVersion << 4 | static_cast<unsigned>(header.type));
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
  } else if (bytes[0] >> 4 != kProtocolVersion) {
    frame.verdict = FrameVerdict::kVersion;
  } else if (!known(bytes[0] & 0xF)) {
    frame.verdict = FrameVerdict::kType;
  } else {
    frame.verdict = FrameVerdict::kAccepted;
    frame.header.type = static_cast<MessageType>(bytes[0] & 0xF);
    frame.header.identity.vehicle_id = bytes[1];
    frame.header.identity.dive_id = static_cast<std::uint16_t>(bytes[2] << 8 | bytes[3]);
    frame.header.sequence = static_cast<std::uint16_t>(bytes[4] << 8 | bytes[5]);
    frame.payload = bytes.subspan(kHeaderBytes, bytes.size() - kFrameOverhead);
  }
  return frame;
}

bool FrameReceiver::admitSequence(std::uint16_t sequence) {
  const auto slot = [&](int s) -> Slot& { return slots_[static_cast<std::uint16_t>(s) % kWindow]; };
  const int ahead = static_cast<std::int16_t>(static_cast<std::uint16_t>(sequence - newest_));
  if (!started_ || ahead > kResyncJump || ahead < -kResyncJump) {
    if (started_) ++counters_.resyncs;
    started_ = true;
    newest_ = sequence;
    slots_.fill(Slot::kBeforeStart);
  } else if (ahead > 0) {
    for (int i = 1; i < ahead; ++i) slot(newest_ + i) = Slot::kMissing;
    counters_.lost += static_cast<std::uint64_t>(ahead - 1);
    newest_ = sequence;
  } else {
    if (ahead <= -kWindow || slot(sequence) == Slot::kSeen) return false;
    if (slot(sequence) == Slot::kMissing) --counters_.lost;
    ++counters_.reordered;
  }
  slot(sequence) = Slot::kSeen;
  return true;
}

DecodedFrame FrameReceiver::accept(std::span<const std::uint8_t> bytes) {
  DecodedFrame frame = decodeFrame(bytes);
  ++counters_.frames;
  counters_.bytes += bytes.size();
  if (frame.verdict == FrameVerdict::kAccepted) {
    if (!identity_) identity_ = frame.header.identity;
    if (frame.header.identity != *identity_) {
      frame.verdict = FrameVerdict::kForeign;
    } else if (!admitSequence(frame.header.sequence)) {
      frame.verdict = FrameVerdict::kDuplicate;
    }
  }
  ++counters_.verdicts[static_cast<std::size_t>(frame.verdict)];
  return frame;
}

void FrameReceiver::rejectPayload() {
  --counters_.verdicts[static_cast<std::size_t>(FrameVerdict::kAccepted)];
  ++counters_.verdicts[static_cast<std::size_t>(FrameVerdict::kBadPayload)];
}

}  // namespace fathom::telemetry
