#include "telemetry/wire/frame.hpp"

#include <algorithm>
#include <array>

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/units.hpp"
#include "telemetry/wire/uplink_messages.hpp"

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

// Mask of the tag's bits that the frame alone determines.
std::uint32_t ownBits(std::span<const std::uint8_t> bytes) {
  return (bytes[0] & kTypeMask) == static_cast<unsigned>(MessageType::kRepair) ? 0xFFFFFF00U : 0xFFFFFFFFU;
}

bool isBundle(std::span<const std::uint8_t> modem_frame) {
  return !modem_frame.empty() && modem_frame[0] == kBundleMark;
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
  writeBigEndian(out.subspan(2, 2), header.identity.dive_id);
  writeBigEndian(out.subspan(4, 2), header.sequence());
  std::copy(payload.begin(), payload.end(), out.begin() + kHeaderBytes);
  writeBigEndian(out.subspan(size - kTagBytes, kTagBytes),
                 tag.of(out.first(size - kTagBytes), lapOf(header.version)) ^ group);
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
    frame.header.identity.dive_id = bigEndianAt<std::uint16_t>(bytes, 2);
    frame.header.version = bigEndianAt<std::uint16_t>(bytes, 4);
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
  const auto last = bigEndianAt<std::uint32_t>(bytes, bytes.size() - kTagBytes);
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

LinkFrames::LinkFrames(std::span<const std::uint8_t> modem_frame)
    : rest_(modem_frame), bundle_(isBundle(modem_frame)) {
  if (bundle_) rest_ = rest_.subspan(kBundleHeadBytes);
}

std::optional<std::span<const std::uint8_t>> LinkFrames::next() {
  if (rest_.empty()) return std::nullopt;
  std::span<const std::uint8_t> frame = rest_;
  rest_ = {};
  if (!bundle_) return frame;
  const std::size_t size = std::size_t{frame[0]} + 1;
  if (frame[0] == 0 || frame.size() < kBundleShareBytes + size) return std::nullopt;
  rest_ = frame.subspan(kBundleShareBytes + size);
  return frame.subspan(kBundleShareBytes, size);
}

std::size_t paddedBytes(std::span<const std::uint8_t> modem_frame) {
  if (!isBundle(modem_frame)) return 0;
  std::size_t used = kBundleHeadBytes;
  LinkFrames frames(modem_frame);
  while (const auto frame = frames.next()) used += kBundleShareBytes + frame->size();
  const auto padding = modem_frame.subspan(used);
  const bool zeros = std::all_of(padding.begin(), padding.end(), [](std::uint8_t b) { return b == 0; });
  return padding.empty() || !zeros ? 0 : modem_frame.size();
}

std::size_t ModemFrameWriter::place() const {
  if (frames_ == 0) return padded_ ? kBundleHeadBytes + kBundleShareBytes : 0;
  return kBundleHeadBytes + (frames_ + 1) * kBundleShareBytes + bytes_;
}

std::span<std::uint8_t> ModemFrameWriter::room() const {
  const std::size_t begin = std::min(place(), out_.size());
  return out_.subspan(begin, std::min(out_.size() - begin, kMaxFrameBytes));
}

void ModemFrameWriter::add(std::size_t size) {
  const bool first_was_alone = frames_ == 1 && !padded_;
  if (first_was_alone) {
    const auto first = out_.first(bytes_);
    std::copy_backward(
        first.begin(), first.end(),
        out_.begin() + static_cast<std::ptrdiff_t>(kBundleHeadBytes + kBundleShareBytes + bytes_));
    out_[kBundleHeadBytes] = static_cast<std::uint8_t>(bytes_ - 1);
  }
  if (frames_ > 0 || padded_) {
    out_[0] = kBundleMark;
    out_[place() - kBundleShareBytes] = static_cast<std::uint8_t>(size - 1);
  }
  ++frames_;
  bytes_ += size;
}

std::size_t ModemFrameWriter::bytesWith(std::size_t more) const {
  return padded_ ? out_.size() : place() + more;
}

std::size_t ModemFrameWriter::finish() {
  if (frames_ == 0) return 0;
  if (frames_ == 1 && !padded_) return bytes_;
  const std::size_t used = place() - kBundleShareBytes;
  if (!padded_) return used;
  std::fill(out_.begin() + static_cast<std::ptrdiff_t>(used), out_.end(), std::uint8_t{0});
  return out_.size();
}

}  // namespace fathom::telemetry
