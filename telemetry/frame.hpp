#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace fathom::telemetry {

// One frame of the acoustic link. Layout (big-endian), 10 bytes around the payload:
//   u4 protocol version, u4 message type, u8 vehicle id, u16 dive id, u16 sequence number, payload, u32 CRC.
// The version nibble and the CRC-32 (IEEE 802.3) over everything before it stay where they are in every
// version. Why 32 bits: a dive sends some 10,000 frames over a channel that damages many; CRC-16 would let
// one damaged frame in 65,536 into a map that nobody can check, CRC-32 one in four thousand million, for two
// bytes more a frame. A frame is as long as its content; a modem's port keeps frame borders (SLIP,
// datagrams).
inline constexpr unsigned kProtocolVersion = 1;
inline constexpr std::size_t kFrameOverhead = 10;
inline constexpr std::size_t kMinFrameBytes = 32;   // smallest frame size that may be configured
inline constexpr std::size_t kMaxFrameBytes = 256;  // largest

enum class MessageType : std::uint8_t {
  kStatus = 1,            // navigation and health in one
  kStatusNavigation = 2,  // the two halves, where frames are too small for one
  kStatusHealth = 3,
  kTrack = 4,
  kMissionInfo = 5,
  kTileFragment = 6,
};
[[nodiscard]] const char* name(MessageType type);

struct LinkIdentity {
  std::uint8_t vehicle_id = 0;
  std::uint16_t dive_id = 0;
  friend bool operator==(const LinkIdentity&, const LinkIdentity&) = default;
};

struct FrameHeader {
  LinkIdentity identity;
  std::uint16_t sequence = 0;
  MessageType type = MessageType::kStatus;
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

// The receiving end: admits frames of one vehicle and dive, once each, and keeps the account of the rest.
class FrameReceiver {
 public:
  // Without an identity the first valid frame's is locked.
  explicit FrameReceiver(std::optional<LinkIdentity> identity = std::nullopt) : identity_(identity) {}

  DecodedFrame accept(std::span<const std::uint8_t> bytes);
  // The message inside an accepted frame turned out to be invalid: moves it to kBadPayload.
  void rejectPayload();

  struct Counters {
    std::array<std::uint64_t, kFrameVerdicts> verdicts{};  // by FrameVerdict
    std::uint64_t frames = 0, bytes = 0;                   // everything given to accept()
    std::uint64_t lost = 0;       // gaps in the sequence numbers that nothing has filled yet
    std::uint64_t reordered = 0;  // accepted after a later frame
    std::uint64_t resyncs = 0;    // jumps too far to be loss: the sender began anew
    [[nodiscard]] std::uint64_t operator[](FrameVerdict v) const {
      return verdicts[static_cast<std::size_t>(v)];
    }
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const std::optional<LinkIdentity>& identity() const { return identity_; }

 private:
  bool admitSequence(std::uint16_t sequence);  // false: duplicate

  // Frames may come this many sequence numbers late and still be told from duplicates; a jump further than
  // kResyncJump in either direction is a sender that restarted.
  static constexpr int kWindow = 256;
  static constexpr int kResyncJump = 4096;
  std::optional<LinkIdentity> identity_;
  bool started_ = false;
  std::uint16_t newest_ = 0;
  enum class Slot : std::uint8_t { kBeforeStart, kMissing, kSeen };
  std::array<Slot, kWindow> slots_{};  // by sequence % kWindow, for (newest - kWindow, newest]
  Counters counters_;
};

}  // namespace fathom::telemetry
