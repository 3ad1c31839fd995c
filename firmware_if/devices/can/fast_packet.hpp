#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "firmware_if/devices/can/can_frame.hpp"

namespace fathom::io {

// Puts NMEA 2000 fast packets (up to 223 bytes in up to 32 frames) together again. The first byte of each
// frame holds a sequence number (3 bits) and a frame index (5 bits); frame 0 adds the length and carries 6
// bytes, the others 7.
//
// Several packets may be in transfer at once; source, destination, PGN and sequence number identify them.
// Frames may come out of order, but only behind their frame 0: a frame 0 always begins a new packet, and a
// repeated frame shows that a frame 0 was lost, so that the packet is dropped rather than mixed with
// another's bytes. Memory is fixed: when all slots are busy, the packet that waited longest is dropped and
// counted.
class FastPacketAssembler {
 public:
  static constexpr std::size_t kMaxBytes = N2kPacket::kMaxBytes;

  struct Config {
    std::size_t slots = 64;  // packets in transfer at once
    // A packet is given up when its next frame takes longer [ns]. NMEA 2000 receivers wait 750 ms.
    std::int64_t timeout_ns = 750'000'000;
  };
  struct Counts {
    std::uint64_t complete = 0;    // packets given out
    std::uint64_t incomplete = 0;  // packets given up: frames lost, late, or no slot left
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
    std::uint32_t missing = 0;  // a bit for each frame still to come
    std::uint64_t last_frame = 0;
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
