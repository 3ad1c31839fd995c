#include "firmware_if/can/raw_can.hpp"

#include <algorithm>

namespace fathom::io {
namespace {

constexpr std::size_t kHeader = 8;
constexpr std::uint32_t kIdMask = 0x1FFFFFFF;
constexpr std::uint32_t kErrorBit = 0x20000000;
constexpr std::int64_t kMicrosecond_ns = 1000;
constexpr std::int64_t kLongest_us = 0xFFFFFF;

std::uint32_t readLittle(std::span<const std::uint8_t> bytes) {
  std::uint32_t out = 0;
  for (std::size_t i = bytes.size(); i-- > 0;) out = (out << 8) | bytes[i];
  return out;
}

void writeLittle(std::uint32_t value, std::span<std::uint8_t> bytes) {
  for (std::uint8_t& byte : bytes) {
    byte = static_cast<std::uint8_t>(value);
    value >>= 8;
  }
}

}  // namespace

bool RawCanWriter::add(const CanFrame& frame, bool error) noexcept {
  if (count_ == kFrames || !frame.utc_ns) return false;
  arrival_ns_ = count_ == 0 ? *frame.utc_ns : std::max(arrival_ns_, *frame.utc_ns);
  records_[count_++] = {frame, error};
  return true;
}

std::span<const std::uint8_t> RawCanWriter::bytes() noexcept {
  std::size_t at = 0;
  for (const RawCanRecord& record : std::span(records_).first(count_)) {
    const CanFrame& frame = record.frame;
    const std::int64_t before_us = std::min((arrival_ns_ - *frame.utc_ns) / kMicrosecond_ns, kLongest_us);
    const std::span<std::uint8_t> out = std::span(bytes_).subspan(at);
    writeLittle((frame.id & kIdMask) | (record.error ? kErrorBit : 0), out.first(4));
    writeLittle(static_cast<std::uint32_t>(before_us), out.subspan(4, 3));
    out[7] = frame.size;
    std::copy_n(frame.data.begin(), frame.size, out.begin() + kHeader);
    at += kHeader + frame.size;
  }
  return {bytes_.data(), at};
}

bool readRawCan(std::span<const std::uint8_t>& bytes, std::int64_t arrival_utc_ns,
                RawCanRecord& out) noexcept {
  if (bytes.size() < kHeader) return false;
  const std::uint32_t id = readLittle(bytes.first(4));
  const std::size_t size = bytes[7];
  if ((id & ~(kIdMask | kErrorBit)) != 0 || size > out.frame.data.size() || bytes.size() < kHeader + size)
    return false;
  out.error = (id & kErrorBit) != 0;
  out.frame.id = id & kIdMask;
  out.frame.utc_ns = arrival_utc_ns - kMicrosecond_ns * readLittle(bytes.subspan(4, 3));
  out.frame.size = static_cast<std::uint8_t>(size);
  out.frame.data = {};
  std::copy_n(bytes.begin() + kHeader, size, out.frame.data.begin());
  bytes = bytes.subspan(kHeader + size);
  return true;
}

}  // namespace fathom::io
