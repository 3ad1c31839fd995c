#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "telemetry/wire/frame_tag.hpp"

namespace fathom::telemetry {

// One frame of the acoustic link. Layout (big-endian), 10 bytes around the payload:
//   u4 protocol version, u1 your turn, u3 message type, u8 vehicle id, u16 dive id, u16 sequence number,
//   payload, u32 tag.
// "Your turn": the vehicle listens after this frame. A repair frame has no sequence number of its own; it
// names the first frame of the group that it repairs. The tag (frame_tag.hpp) stands where every protocol had
// its check. A frame is as long as its content; a modem's port keeps frame borders (SLIP, datagrams).
//
// Of the versions before, whose frames ended with a CRC-32, recordings are read, where no key is asked for.
inline constexpr unsigned kProtocolVersion = 4;
inline constexpr std::size_t kFrameOverhead = 10;
inline constexpr std::size_t kMinFrameBytes = 32;   // smallest frame size that may be configured
inline constexpr std::size_t kMaxFrameBytes = 256;  // largest

enum class MessageType : std::uint8_t {
  kReport = 0,
  kStatus = 1,
  kTrack = 2,
  kMissionInfo = 3,
  kMapPacket = 4,
  kRepair = 5,
  kTileFragment = 6,
  kDownlink = 7,  // from the ship to the vehicle; all others go the other way
};
inline constexpr std::size_t kMessageTypes = 8;  // size of an array by MessageType
[[nodiscard]] const char* name(MessageType type);

// A frame's number: its sequence number with the bits that the frame leaves out, the lap. It grows by one a
// frame, over a dive and from one dive to the next. Blocks are named by the frame that carried them.
using Version = std::uint32_t;
[[nodiscard]] constexpr std::uint16_t lapOf(Version version) {
  return static_cast<std::uint16_t>(version >> 16);
}
// The first frame of a dive that began then: a lap more for every two hours since 2025, so that no dive has
// the numbers of one before. They begin again after 15 years.
[[nodiscard]] Version firstVersion(std::int64_t start_utc_ns);
// The version nearest to `near` that has this sequence number.
[[nodiscard]] inline Version versionNear(std::uint16_t sequence, Version near) {
  return near + static_cast<Version>(static_cast<std::int32_t>(static_cast<std::int16_t>(
                    static_cast<std::uint16_t>(sequence - static_cast<std::uint16_t>(near)))));
}

struct FrameHeader {
  LinkIdentity identity;
  Version version = 0;  // of a repair frame: that of its group's first frame
  MessageType type = MessageType::kStatus;
  bool turn = false;  // the sender listens after this frame
  [[nodiscard]] std::uint16_t sequence() const { return static_cast<std::uint16_t>(version); }
};

enum class FrameVerdict : std::uint8_t {
  kAccepted,
  kTooShort,    // shorter than header and CRC
  kTooLong,     // longer than kMaxFrameBytes
  kBadTag,      // damaged, forged, or made with another key
  kVersion,     // another protocol version
  kType,        // the ship's own voice, heard by the ship
  kForeign,     // another vehicle or dive
  kDuplicate,   // seen already
  kBadPayload,  // the frame is whole, its message is not valid (counted by whoever decodes the message)
  kUnkeyed,     // whole, but made without a key, where one is asked for
  kOld,         // of a dive before this one, kept back or played again
};
inline constexpr std::size_t kFrameVerdicts = 11;
[[nodiscard]] const char* name(FrameVerdict verdict);

// Returns the frame's size, 0 if `out` is too small or the payload too long. `group`, of a repair frame: see
// DecodedFrame.
[[nodiscard]] std::size_t encodeFrame(const FrameHeader& header, std::span<const std::uint8_t> payload,
                                      std::span<std::uint8_t> out, const FrameTag& tag = {},
                                      std::uint8_t group = 0);

struct DecodedFrame {
  FrameVerdict verdict = FrameVerdict::kTooShort;
  FrameHeader header;                     // valid from kForeign on
  std::span<const std::uint8_t> payload;  // points into the bytes given; valid when accepted
  bool whole_version = false;             // the tag proves the lap; else the version has lap 0
  // Of a repair frame: 8 bits of a digest of all that its group carried. They are added (exclusive or) to the
  // tag's last byte, so that the other three prove the frame by itself, and all what is repaired with
  // it.
  std::optional<std::uint8_t> group;  // none in protocols before
};
// Checks everything that one frame alone can tell (not identity, not duplicates). With a key the laps given
// are tried one after the other.
[[nodiscard]] DecodedFrame decodeFrame(std::span<const std::uint8_t> bytes, const FrameTag& tag = {},
                                       std::span<const std::uint16_t> laps = {});
// What a frame says of itself, nothing of it checked but that it can be one.
[[nodiscard]] DecodedFrame peekFrame(std::span<const std::uint8_t> bytes);

}  // namespace fathom::telemetry
