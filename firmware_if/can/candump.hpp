#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "firmware_if/can/can_frame.hpp"

namespace fathom::io {

enum class CandumpLine : std::uint8_t {
  kFrame,   // an extended data frame
  kBlank,   // empty, or a comment that begins with #
  kOther,   // a CAN line, but not such a frame: 11-bit identifier, remote, error or CAN FD frame
  kBroken,  // not a line of candump
};

// Reads one line, without its line end, of can-utils' candump: the log form `(1502984866.421964) can0
// 09F112CC#FF725AFF7FFF7FFD` (-l, -L) or the screen form `(1502984866.421964)  can0  09F112CC   [8]  FF 72 5A
// ...`. The time in seconds may be missing; one in another form (a local date, -t A) is absent.
[[nodiscard]] CandumpLine parseCandumpLine(std::string_view line, CanFrame& frame) noexcept;

// Splits a stream of bytes, cut anywhere, into lines and frames. Memory is fixed; a line longer than any that
// candump writes is broken.
class CandumpReader {
 public:
  struct Counts {
    std::uint64_t frames = 0;
    std::uint64_t other = 0;   // see CandumpLine::kOther
    std::uint64_t broken = 0;  // lines
  };

  // Calls `on_frame(const CanFrame&)` for each frame whose line ends in `bytes`.
  template <class OnFrame>
  void feed(std::span<const std::uint8_t> bytes, OnFrame&& on_frame) {
    for (const std::uint8_t byte : bytes) {
      if (byte != '\n') {
        if (size_ < line_.size()) line_[size_] = static_cast<char>(byte);
        ++size_;
      } else if (const CanFrame* frame = endLine()) {
        on_frame(*frame);
      }
    }
  }
  // Says that no more bytes will come: the last line may lack its line end.
  template <class OnFrame>
  void drain(OnFrame&& on_frame) {
    if (const CanFrame* frame = endLine()) on_frame(*frame);
  }

  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }

 private:
  const CanFrame* endLine() noexcept;

  std::array<char, 512> line_{};  // a classic frame in the widest screen form is below 120 characters
  std::size_t size_ = 0;          // may exceed the array: then the line is too long
  CanFrame frame_;
  Counts counts_;
};

}  // namespace fathom::io
