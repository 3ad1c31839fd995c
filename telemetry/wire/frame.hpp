#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "realtime/kernel/frame_port.hpp"
#include "telemetry/wire/link_key.hpp"

namespace fathom::telemetry {

// One frame of the acoustic link. Layout (big-endian), 10 bytes around the payload:
//   u4 protocol version, u1 your turn, u3 message type, u8 vehicle id, u16 dive id, u16 sequence number,
//   payload, u32 tag.
// "Your turn": the vehicle listens after this frame. A repair frame has no sequence number of its own; it
// carries that of the first frame of its group. The tag is FrameTag's. A frame is as long as its content; a
// modem's port keeps frame borders (SLIP, datagrams).
//
// Recordings of the versions before, in which frames end with a CRC-32, are read when no key is required.
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
  kDownlink = 7,  // from the ship to the vehicle; all others from the vehicle to the ship
};
inline constexpr std::size_t kMessageTypes = 8;  // size of an array by MessageType
[[nodiscard]] const char* name(MessageType type);

// A frame's number: 16 bits of lap, which the frame leaves out, and its sequence number. It grows by one a
// frame, over a dive and from one dive to the next. Blocks are identified by the frame that carried them.
using Version = std::uint32_t;
[[nodiscard]] constexpr std::uint16_t lapOf(Version version) {
  return static_cast<std::uint16_t>(version >> 16);
}
// Version of the first frame of a dive that began at this time: one lap for every two hours since 2025, so
// that no dive has the numbers of one before. The laps repeat after 15 years.
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
  kBadTag,      // damaged, forged, or of another key
  kVersion,     // another protocol version
  kType,        // a downlink frame, received by the ship
  kForeign,     // another vehicle or dive
  kDuplicate,   // seen already
  kBadPayload,  // the frame is whole, its message is not valid (counted by the decoder of the message)
  kUnkeyed,     // whole, but without a key, where one is required
  kOld,         // of an earlier dive: delayed or replayed
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
  bool whole_version = false;             // the tag includes the lap; otherwise the version has lap 0
  // Of a repair frame: 8 bits of a digest of its group's content, combined (exclusive or) with the tag's last
  // byte. The other three bytes authenticate the frame itself, all four what is repaired with it.
  std::optional<std::uint8_t> group;  // none in protocols before
};
// Checks one frame by itself (neither identity nor duplicates). With a key the given laps are tried one after
// the other.
[[nodiscard]] DecodedFrame decodeFrame(std::span<const std::uint8_t> bytes, const FrameTag& tag = {},
                                       std::span<const std::uint16_t> laps = {});
// Reads the header without checking the tag.
[[nodiscard]] DecodedFrame peekFrame(std::span<const std::uint8_t> bytes);

// A modem frame, which the modem takes at once, is one link frame as it is, or a bundle of link frames:
//   u8 0xF0, then for each link frame u8 its length less one, and its bytes; a zero byte or the end of the
//   modem frame ends it.
// No link frame begins with 0xF0, which is no protocol version, and none has one byte, so that a modem with
// frames of one size may fill them with zeros. A bundle has no check of its own: each link frame in it has
// its tag.
inline constexpr std::uint8_t kBundleMark = 0xF0;
inline constexpr std::size_t kBundleHeadBytes = 1, kBundleShareBytes = 1;  // of a bundle; before each frame
inline constexpr std::size_t kMinModemBytes = 64;  // of a modem frame that carries bundles
inline constexpr std::size_t kMaxModemBytes = FramePort::kMaxFrameBytes;

// Iterates over the link frames of a modem frame of any bytes. It stops at a link frame that reaches beyond
// the end.
class LinkFrames {
 public:
  explicit LinkFrames(std::span<const std::uint8_t> modem_frame);
  // The next link frame, of at least one byte; nullopt at the end.
  [[nodiscard]] std::optional<std::span<const std::uint8_t>> next();

 private:
  std::span<const std::uint8_t> rest_;
  bool bundle_;
};

// Size of a bundle padded with zeros, as modems with frames of one size send it; 0 for any other modem frame.
[[nodiscard]] std::size_t paddedBytes(std::span<const std::uint8_t> modem_frame);

// Writes link frames into a modem frame in the caller's buffer, of out.size() bytes at most.
class ModemFrameWriter {
 public:
  // `padded`: always writes a bundle, filled with zeros to out.size(); otherwise a single link frame is
  // written as it is.
  ModemFrameWriter(std::span<std::uint8_t> out, bool padded) : out_(out), padded_(padded) {}
  // Room for the next link frame, to be written before add(); empty when there is none.
  [[nodiscard]] std::span<std::uint8_t> room() const;
  // Adds the link frame of `size` bytes, 1 to 256, that was written into room().
  void add(std::size_t size);
  // Size of the modem frame with another link frame of `more` bytes [B].
  [[nodiscard]] std::size_t bytesWith(std::size_t more) const;
  // Ends the modem frame and returns its size, 0 when nothing was added.
  [[nodiscard]] std::size_t finish();

 private:
  // Offset of the next link frame. The first one is written without a bundle head until a second is added.
  [[nodiscard]] std::size_t place() const;

  std::span<std::uint8_t> out_;
  bool padded_;
  std::size_t frames_ = 0, bytes_ = 0;  // of link frames
};

}  // namespace fathom::telemetry
