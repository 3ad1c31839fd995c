#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "realtime/kernel/frame_port.hpp"

namespace fathom::io {

// SLIP (RFC 1055): a frame ends with END (0xC0); END and ESC inside it travel as two bytes. An END goes out
// before each frame too, so that line noise ends in a frame of its own. The line protocol only finds frames;
// the CRC inside them says whether they are undamaged.
constexpr std::size_t kMaxSlipBytes = 2 * FramePort::kMaxFrameBytes + 2;

// Encodes `frame` into `out` (at least kMaxSlipBytes) and returns the bytes used; 0 for an empty or too long
// frame.
[[nodiscard]] std::size_t slipEncode(std::span<const std::uint8_t> frame,
                                     std::span<std::uint8_t> out) noexcept;

// Takes the bytes of a line one by one. Fixed memory.
class SlipDecoder {
 public:
  // True when `byte` ends a frame, which is then in frame() until the next call. Empty frames are passed
  // over; frames that are too long or hold a false escape are dropped and counted.
  [[nodiscard]] bool push(std::uint8_t byte) noexcept;
  // Forgets a frame that has begun, and counts it as dropped.
  void restart() noexcept;
  [[nodiscard]] std::span<const std::uint8_t> frame() const noexcept { return {frame_.data(), finished_}; }
  [[nodiscard]] std::uint64_t dropped() const noexcept { return dropped_; }

 private:
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> frame_ = {};
  std::size_t size_ = 0, finished_ = 0;
  bool escaped_ = false;
  bool broken_ = false;
  std::uint64_t dropped_ = 0;
};

}  // namespace fathom::io
