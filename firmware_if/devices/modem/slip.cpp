#include "firmware_if/devices/modem/slip.hpp"

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

}  // namespace fathom::io
