#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "firmware_if/devices/can/can_frame.hpp"

namespace fathom::io {

// What a line of a text capture is.
enum class CanLine : std::uint8_t {
  kFrame,   // an extended data frame
  kPacket,  // a whole message
  kBlank,   // empty, or a comment that begins with #
  kOther,   // a valid line of another frame: 11-bit identifier, remote, error, CAN FD, gateway's own
  kBroken,  // none of these
};

// Reads one line, without its line end, of can-utils' candump: the log form `(1502984866.421964) can0
// 09F112CC#FF725AFF7FFF7FFD` (-l, -L) or the screen form `(1502984866.421964)  can0  09F112CC   [8]  FF 72 5A
// ...`. A frame whose time is missing or not in seconds (a local date, -t A) has none.
[[nodiscard]] CanLine parseCandumpLine(std::string_view line, CanFrame& frame) noexcept;

// Splits a stream of text, cut anywhere, into lines, and reads each in the form that it has: candump's,
// canboat's plain form, Yacht Devices' RAW or Actisense's N2K ASCII. Frames and whole messages are
// delivered in the order of their lines. Memory is fixed; a line longer than any of these forms counts as
// broken.
class CanTextReader {
 public:
  struct Counts {
    std::uint64_t frames = 0, packets = 0;
    std::uint64_t other = 0;   // see CanLine::kOther
    std::uint64_t broken = 0;  // malformed lines
  };
  struct Ignore {
    void operator()(const N2kPacket&) const noexcept {}
  };

  // Calls `on_frame(const CanFrame&)` for each frame, `on_packet(const N2kPacket&)` for each whole message,
  // as soon as `bytes` has its line's end.
  template <class OnFrame, class OnPacket = Ignore>
  void feed(std::span<const std::uint8_t> bytes, OnFrame&& on_frame, OnPacket&& on_packet = {}) {
    for (const std::uint8_t byte : bytes) {
      if (byte != '\n') {
        if (size_ < line_.size()) line_[size_] = static_cast<char>(byte);
        ++size_;
      } else {
        drain(on_frame, on_packet);
      }
    }
  }
  // No more bytes will come: reads the last line, which may lack its line end.
  template <class OnFrame, class OnPacket = Ignore>
  void drain(OnFrame&& on_frame, OnPacket&& on_packet = {}) {
    const CanLine kind = endLine();
    if (kind == CanLine::kFrame) on_frame(frame_);
    if (kind == CanLine::kPacket) on_packet(packet_);
  }

  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }

 private:
  [[nodiscard]] CanLine endLine() noexcept;
  [[nodiscard]] CanLine readLine(std::string_view line) noexcept;

  std::array<char, 1024> line_{};  // a message of 223 bytes in canboat's form is below 720 characters
  std::size_t size_ = 0;           // may exceed the array: then the line is too long
  CanFrame frame_;
  N2kPacket packet_;
  bool whole_ = false;  // a canboat line had more than 8 bytes: its file has whole messages, not frames
  Counts counts_;
};

}  // namespace fathom::io
