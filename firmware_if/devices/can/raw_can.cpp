#include "firmware_if/devices/can/raw_can.hpp"

#include <algorithm>

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kRawCanHeader = 8;
constexpr std::uint32_t kIdMask = 0x1FFFFFFF;
constexpr std::uint32_t kErrorBit = 0x20000000;
constexpr std::int64_t kLongest_us = 0xFFFFFF;

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
    writeLittleEndian(out.first(4), (frame.id & kIdMask) | (record.error ? kErrorBit : 0));
    writeLittleEndian(out.subspan(4, 3), static_cast<std::uint64_t>(before_us));
    out[7] = frame.size;
    std::copy_n(frame.data.begin(), frame.size, out.begin() + kRawCanHeader);
    at += kRawCanHeader + frame.size;
  }
  return {bytes_.data(), at};
}

bool readRawCan(std::span<const std::uint8_t>& bytes, std::int64_t arrival_utc_ns,
                RawCanRecord& out) noexcept {
  if (bytes.size() < kRawCanHeader) return false;
  const auto id = littleEndianAt<std::uint32_t>(bytes, 0);
  const std::size_t size = bytes[7];
  if ((id & ~(kIdMask | kErrorBit)) != 0 || size > out.frame.data.size() ||
      bytes.size() < kRawCanHeader + size)
    return false;
  out.error = (id & kErrorBit) != 0;
  out.frame.id = id & kIdMask;
  out.frame.utc_ns =
      arrival_utc_ns - kMicrosecond_ns * static_cast<std::int64_t>(readLittleEndian(bytes.subspan(4, 3)));
  out.frame.size = static_cast<std::uint8_t>(size);
  out.frame.data = {};
  std::copy_n(bytes.begin() + kRawCanHeader, size, out.frame.data.begin());
  bytes = bytes.subspan(kRawCanHeader + size);
  return true;
}

}  // namespace fathom::io
