#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace fathom::telemetry {

// One frame of the acoustic link. Layout (big-endian), 10 bytes around the payload:
//   u4 protocol version, u1 your turn, u3 message type, u8 vehicle id, u16 dive id, u16 sequence number,
//   payload, u32 CRC.
// "Your turn": the vehicle listens after this frame. A repair frame has no sequence number of its own; it
// names the first frame of the group that it repairs. The version nibble and the CRC-32 (IEEE 802.3) over
// everything before it stay where they are in every version. Why 32 bits: a dive sends some 10,000 frames
// over a channel that damages many; CRC-16 would let one damaged frame in 65,536 into a map that nobody can
// check, CRC-32 one in four thousand million, for two bytes more a frame. A frame is as long as its content;
// a modem's port keeps frame borders (SLIP, datagrams).
//
// Of version 2, the one before, everything but the downlink is the same: recordings are read.
inline constexpr unsigned kProtocolVersion = 3;
inline constexpr std::size_t kFrameOverhead = 10;
inline constexpr std::size_t kMinFrameBytes = 32;   // smallest frame size that may be configured
inline constexpr std::size_t kMaxFrameBytes = 256;  // largest

enum class MessageType : std::uint8_t {
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

struct LinkIdentity {
  std::uint8_t vehicle_id = 0;
  std::uint16_t dive_id = 0;
  friend bool operator==(const LinkIdentity&, const LinkIdentity&) = default;
};

// A frame's place in the dive: its sequence number with the bits that the frame leaves out. It grows by one a
// frame; either end counts from its own beginning. Blocks are named by the frame that carried them.
using Version = std::uint32_t;
// The version nearest to `near` that has this sequence number.
[[nodiscard]] inline Version versionNear(std::uint16_t sequence, Version near) {
  return near + static_cast<Version>(static_cast<std::int32_t>(static_cast<std::int16_t>(
                    static_cast<std::uint16_t>(sequence - static_cast<std::uint16_t>(near)))));
}

struct FrameHeader {
  LinkIdentity identity;
  std::uint16_t sequence = 0;
  MessageType type = MessageType::kStatus;
  bool turn = false;  // the sender listens after this frame
};

enum class FrameVerdict : std::uint8_t {
  kAccepted,
  kTooShort,    // shorter than header and CRC
  kTooLong,     // longer than kMaxFrameBytes
  kBadCrc,      // damaged, or not ours at all
  kVersion,     // another protocol version
  kType,        // a message type that this version does not have
  kForeign,     // another vehicle or dive
  kDuplicate,   // seen already
  kBadPayload,  // the frame is whole, its message is not valid (counted by whoever decodes the message)
};
inline constexpr std::size_t kFrameVerdicts = 9;
[[nodiscard]] const char* name(FrameVerdict verdict);

// Returns the frame's size, 0 if `out` is too small or the payload too long.
[[nodiscard]] std::size_t encodeFrame(const FrameHeader& header, std::span<const std::uint8_t> payload,
                                      std::span<std::uint8_t> out);

struct DecodedFrame {
  FrameVerdict verdict = FrameVerdict::kTooShort;
  FrameHeader header;                     // valid from kForeign on
  std::span<const std::uint8_t> payload;  // points into the bytes given; valid when accepted
};
// Checks everything that one frame alone can tell (not identity, not duplicates).
[[nodiscard]] DecodedFrame decodeFrame(std::span<const std::uint8_t> bytes);

}  // namespace fathom::telemetry
