#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware_if/can/can_frame.hpp"
#include "firmware_if/can/line_words.hpp"

namespace fathom::io {

// Splits a stream of text, cut anywhere, into lines, and reads each in the form that it has: candump's, or
// one of gateway_text. Frames and whole messages come out in the lines' order. Memory is fixed; a line longer
// than any of these forms' is broken.
class CanTextReader {
 public:
  struct Counts {
    std::uint64_t frames = 0, packets = 0;
    std::uint64_t other = 0;   // see CanLine::kOther
    std::uint64_t broken = 0;  // lines
  };
  struct Ignore {
    void operator()(const N2kPacket&) const noexcept {}
  };

  // Calls `on_frame(const CanFrame&)` for each frame whose line ends in `bytes`, `on_packet(const
  // N2kPacket&)` for each whole message.
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
  // Says that no more bytes will come: the last line may lack its line end.
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
  bool whole_ = false;  // canboat lines are whole messages: one did not fit into a frame
  Counts counts_;
};

}  // namespace fathom::io
