#include "firmware_if/modem/waiting_frame_port.hpp"

#include <exception>

#include "realtime/kernel/clock.hpp"

namespace fathom::io {

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

void WaitingFramePort::answerHeard() noexcept {
  if (port_ != nullptr) port_->answerHeard();
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
