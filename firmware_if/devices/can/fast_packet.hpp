#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "firmware_if/devices/can/can_frame.hpp"

namespace fathom::io {

// Reassembles NMEA 2000 fast packets (up to 223 bytes in up to 32 frames). The first byte of each
// frame holds a sequence number (3 bits) and a frame index (5 bits); frame 0 adds the length and carries 6
// bytes, the others 7.
//
// Several packets may be in transfer at once; source, destination, PGN and sequence number identify them.
// Frames may arrive in any order after their frame 0, which always begins a new packet. A frame index that
// arrives twice means that the frame 0 of a newer packet was lost: the packet is dropped, so that the bytes
// of two are never mixed. Memory is fixed: when all slots are busy, the least recently updated packet is
// dropped and counted.
class FastPacketAssembler {
 public:
  static constexpr std::size_t kMaxBytes = N2kPacket::kMaxBytes;

  struct Config {
    std::size_t slots = 64;  // packets in transfer at once
    // Longest gap between two frames of a packet, by their times; NMEA 2000 receivers wait 750 ms.
    std::int64_t timeout_ns = 750'000'000;
  };
  struct Counts {
    std::uint64_t complete = 0;    // packets delivered
    std::uint64_t incomplete = 0;  // packets dropped: frames lost, repeated or late, or no slot left
    std::uint64_t orphans = 0;     // frames that belong to no packet in transfer
    std::uint64_t broken = 0;      // frames too short, or with an impossible length or index
  };

  FastPacketAssembler() : FastPacketAssembler(Config{}) {}
  explicit FastPacketAssembler(const Config& config);

  // Takes one frame of a fast-packet PGN. When it completes a packet, returns the packet's bytes, valid until
  // the next call; else an empty span. Allocates nothing.
  [[nodiscard]] std::span<const std::uint8_t> add(const N2kId& id, const CanFrame& frame) noexcept;

  // No more frames will come: packets still in transfer count as incomplete.
  void finish() noexcept;

  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }

 private:
  struct Slot {
    bool busy = false;
    std::uint32_t pgn = 0;
    std::uint8_t source = 0;
    std::uint8_t destination = 0;
    std::uint8_t sequence = 0;
    std::uint8_t length = 0;
    std::uint32_t missing = 0;           // a bit for each frame not received yet
    std::uint64_t updated = 0;           // frames_ at its last frame
    std::optional<std::int64_t> utc_ns;  // of the last frame
    std::array<std::uint8_t, kMaxBytes> bytes{};
  };
  [[nodiscard]] Slot* find(const N2kId& id, std::uint8_t sequence) noexcept;
  [[nodiscard]] Slot& freeSlot() noexcept;
  void giveUp(Slot& slot) noexcept;

  Config config_;
  std::vector<Slot> slots_;
  std::uint64_t frames_ = 0;  // orders the slots by age without a clock
  Counts counts_;
};

}  // namespace fathom::io
