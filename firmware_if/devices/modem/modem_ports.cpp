#include "firmware_if/devices/modem/modem_ports.hpp"

#include <cstring>
#include <exception>

#include "realtime/base/input_error.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {
namespace {

constexpr std::uint8_t kEnd = 0xC0, kEscape = 0xDB, kEscapedEnd = 0xDC, kEscapedEscape = 0xDD;

}  // namespace

std::size_t slipEncode(std::span<const std::uint8_t> frame, std::span<std::uint8_t> out) noexcept {
  if (frame.empty() || frame.size() > FramePort::kMaxFrameBytes || out.size() < kMaxSlipBytes) return 0;
  std::size_t n = 0;
  out[n++] = kEnd;
  for (const std::uint8_t byte : frame) {
    if (byte == kEnd || byte == kEscape) {
      out[n++] = kEscape;
      out[n++] = byte == kEnd ? kEscapedEnd : kEscapedEscape;
    } else {
      out[n++] = byte;
    }
  }
  out[n++] = kEnd;
  return n;
}

bool SlipDecoder::push(std::uint8_t byte) noexcept {
  finished_ = 0;
  if (byte == kEnd) {
    const bool broken = broken_ || escaped_;
    const std::size_t size = size_;
    size_ = 0;
    broken_ = escaped_ = false;
    if (broken) {
      ++dropped_;
      return false;
    }
    finished_ = size;
    return size > 0;
  }
  if (broken_) return false;
  if (byte == kEscape && !escaped_) {
    escaped_ = true;
    return false;
  }
  if (escaped_) {
    escaped_ = false;
    if (byte != kEscapedEnd && byte != kEscapedEscape) {
      broken_ = true;
      return false;
    }
    byte = byte == kEscapedEnd ? kEnd : kEscape;
  }
  if (size_ == frame_.size()) {
    broken_ = true;
    return false;
  }
  frame_[size_++] = byte;
  return false;
}

void SlipDecoder::restart() noexcept {
  if (size_ > 0 || escaped_ || broken_) ++dropped_;
  size_ = finished_ = 0;
  escaped_ = broken_ = false;
}

UdpFramePort::UdpFramePort(const std::string& bind_address, std::uint16_t bind_port,
                           const std::string& peer_address, std::uint16_t peer_port)
    : peer_given_(peer_port != 0) {
  if (peer_given_) peer_ = parseUdpAddress(peer_address, peer_port);
  if (const int error = socket_.bind(parseUdpAddress(bind_address, bind_port)); error != 0)
    throw InputError(
        bind_address + ":" + std::to_string(bind_port), "",
        std::string("cannot be bound (") + std::strerror(error) + "); give a free port of this machine");
}

bool UdpFramePort::send(std::span<const std::uint8_t> frame) noexcept {
  if (peer_.port == 0 || frame.empty() || frame.size() > kMaxFrameBytes) return false;
  return socket_.send(frame, peer_);
}

void UdpFramePort::answerLastSender() noexcept {
  if (!peer_given_) peer_ = last_sender_;
}

std::size_t UdpFramePort::receive(std::span<std::uint8_t> buffer) noexcept {
  // One byte more than a frame: a datagram that fills it is too long.
  std::array<std::uint8_t, kMaxFrameBytes + 1> datagram;
  // A flood of unusable datagrams must not hold the caller: some are dropped, the rest wait for the next
  // call.
  constexpr int kMaxDrops = 64;
  for (int i = 0; i < kMaxDrops; ++i) {
    UdpAddress sender;
    const auto size = socket_.receive(datagram, sender);
    if (!size) return 0;
    if (*size > 0 && *size <= kMaxFrameBytes && *size <= buffer.size() && (sender == peer_ || !peer_given_)) {
      last_sender_ = sender;
      std::memcpy(buffer.data(), datagram.data(), *size);
      return *size;
    }
    ++dropped_;
  }
  return 0;
}

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

// Writes what the device takes of the frame being sent; true when nothing is left.
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

WaitingFramePort::WaitingFramePort(Open open, std::int64_t first_wait_ns)
    : open_(std::move(open)), wait_(first_wait_ns, kLongestWaitNs) {
  static_cast<void>(ready());
}

bool WaitingFramePort::ready() noexcept {
  if (port_ != nullptr) return true;
  const std::int64_t now_ns = rt::RealClock().monotonicNs();
  if (!wait_.due(now_ns)) return false;
  try {
    port_ = open_();
  } catch (const std::exception& e) {
    wait_.failed(now_ns);
    try {
      reason_ = e.what();
    } catch (const std::exception&) {
      reason_ = "no memory";
    }
  }
  return port_ != nullptr;
}

bool WaitingFramePort::send(std::span<const std::uint8_t> frame) noexcept {
  return ready() && port_->send(frame);
}

std::size_t WaitingFramePort::receive(std::span<std::uint8_t> buffer) noexcept {
  return ready() ? port_->receive(buffer) : 0;
}

void WaitingFramePort::answerLastSender() noexcept {
  if (port_ != nullptr) port_->answerLastSender();
}

std::uint64_t WaitingFramePort::droppedFrames() const noexcept {
  return port_ == nullptr ? 0 : port_->droppedFrames();
}

bool WaitingFramePort::isOpen() const noexcept {
  return port_ != nullptr && port_->isOpen();
}

std::string_view WaitingFramePort::reason() const noexcept {
  return port_ == nullptr ? std::string_view(reason_) : port_->reason();
}

}  // namespace fathom::io
