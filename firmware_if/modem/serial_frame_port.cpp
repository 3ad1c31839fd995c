#include <cstring>

#include "firmware_if/modem/modem_ports.hpp"

namespace fathom::io {

SerialFramePort::SerialFramePort(const std::string& device, int baud, double reopen_interval_s)
    : serial_(device, baud, SerialLine::IfAbsent::kRefuse, reopen_interval_s),
      connection_(serial_.connections()) {}

bool SerialFramePort::ready() noexcept {
  // What came before the line went is used up first.
  if (input_at_ < input_size_ && serial_.isOpen()) return true;
  const bool there = serial_.ready();
  if (serial_.connections() != connection_) {
    // What was half sent will not be completed, nor will what was half received.
    connection_ = serial_.connections();
    line_size_ = line_sent_ = 0;
    input_size_ = input_at_ = 0;
    decoder_.restart();
  }
  return there;
}

// Writes what the device takes of the frame under way; true when nothing is left.
bool SerialFramePort::drain() noexcept {
  while (line_sent_ < line_size_) {
    const std::size_t n = serial_.write(std::span(line_).subspan(line_sent_, line_size_ - line_sent_));
    if (n == 0) return false;
    line_sent_ += n;
  }
  return true;
}

bool SerialFramePort::send(std::span<const std::uint8_t> frame) noexcept {
  // The rest of the frame before goes first: a frame is never cut by the next.
  if (!ready() || !drain()) return false;
  line_size_ = slipEncode(frame, line_);
  line_sent_ = 0;
  if (line_size_ == 0) return false;
  static_cast<void>(drain());
  return serial_.isOpen();
}

std::size_t SerialFramePort::receive(std::span<std::uint8_t> buffer) noexcept {
  if (!ready() && input_at_ == input_size_) return 0;
  static_cast<void>(drain());
  // Noise without a frame must not hold the caller: the rest waits for the next call.
  constexpr int kMaxReads = 16;
  for (int i = 0; i < kMaxReads; ++i) {
    while (input_at_ < input_size_) {
      if (!decoder_.push(input_[input_at_++])) continue;
      const auto frame = decoder_.frame();
      if (frame.size() > buffer.size()) {
        ++dropped_;
        continue;
      }
      std::memcpy(buffer.data(), frame.data(), frame.size());
      return frame.size();
    }
    if (!ready()) return 0;
    input_at_ = 0;
    input_size_ = serial_.read(input_, 0);
    if (input_size_ == 0) return 0;
  }
  return 0;
}

}  // namespace fathom::io
