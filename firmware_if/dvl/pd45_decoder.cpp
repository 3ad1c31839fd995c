#include "firmware_if/dvl/pd45_decoder.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

namespace fathom::io {
namespace {

constexpr std::uint8_t kHeaderId = 0x7D;
constexpr std::size_t kHeaderBytes = 4, kChecksumBytes = 2;
constexpr std::int16_t kBadVelocity = -32768;
constexpr std::int64_t kSecond = 1'000'000'000, kDay = 86'400 * kSecond;  // [ns]

std::uint16_t u16(const std::uint8_t* bytes) {
  return static_cast<std::uint16_t>(bytes[0] | (bytes[1] << 8));
}
std::int16_t i16(const std::uint8_t* bytes) {
  return static_cast<std::int16_t>(u16(bytes));
}

// Byte offsets from the start of the ensemble (the guide counts from 1).
Pd45Ensemble readEnsemble(std::span<const std::uint8_t> bytes) {
  const std::uint8_t* b = bytes.data();
  Pd45Ensemble out;
  out.pd5 = b[1] == 1;
  out.frame = static_cast<Pd0Frame>(b[4] >> 6);
  out.tilts_used = (b[4] & 0x20) != 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::int16_t velocity_mm = i16(b + 5 + 2 * i);
    if (velocity_mm != kBadVelocity) out.velocity[i] = velocity_mm / 1000.0;
    const std::uint16_t range_cm = u16(b + 13 + 2 * i);
    if (range_cm != 0) out.range[i] = range_cm / 100.0;
  }
  const int hour = b[35], minute = b[36], second = b[37], hundredth = b[38];
  if (hour < 24 && minute < 60 && second < 60 && hundredth < 100)
    out.time_of_day_ns = ((hour * 60 + minute) * 60 + second) * kSecond + hundredth * (kSecond / 100);
  if (u16(b + 41) != 0 && u16(b + 41) != 0xFFFF) out.sound_speed = u16(b + 41);
  if (i16(b + 43) != kBadVelocity) out.temperature_c = i16(b + 43) / 100.0;
  if (!out.pd5) return out;
  if (i16(b + 48) != kBadVelocity) out.pitch_deg = i16(b + 48) / 100.0;
  if (i16(b + 50) != kBadVelocity) out.roll_deg = i16(b + 50) / 100.0;
  if (u16(b + 52) < 36000) out.heading_deg = u16(b + 52) / 100.0;
  return out;
}

}  // namespace

Pd0Ensemble toPd0(const Pd45Ensemble& ensemble, std::int64_t near_utc_ns) {
  Pd0Ensemble out;
  out.frame = ensemble.frame;
  out.tilts_used = ensemble.tilts_used;
  out.beams = 4;
  if (ensemble.time_of_day_ns) {
    // The day whose such time is less than half a day away.
    const std::int64_t since = near_utc_ns - kDay / 2 - *ensemble.time_of_day_ns;
    const std::int64_t days = since / kDay + (since % kDay > 0 ? 1 : 0);
    out.utc_ns = days * kDay + *ensemble.time_of_day_ns;
  }
  out.sound_speed = ensemble.sound_speed;
  out.temperature_c = ensemble.temperature_c;
  out.heading_deg = ensemble.heading_deg;
  out.pitch_deg = ensemble.pitch_deg;
  out.roll_deg = ensemble.roll_deg;
  Pd0BottomTrack track;
  track.range = ensemble.range;
  for (std::size_t i = 0; i < 4; ++i)
    if (ensemble.velocity[i]) track.velocity[i] = -*ensemble.velocity[i];
  out.bottom_track = track;
  return out;
}

std::size_t Pd45Decoder::accept(std::span<const std::uint8_t> bytes) noexcept {
  if (buffer_.size() - end_ < bytes.size() && begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
    raw_ = {};
  }
  const std::size_t taken = std::min(bytes.size(), buffer_.size() - end_);
  if (taken > 0) std::memcpy(buffer_.data() + end_, bytes.data(), taken);
  end_ += taken;
  return taken;
}

void Pd45Decoder::skip(std::size_t bytes) noexcept {
  begin_ += bytes;
  counts_.skipped_bytes += bytes;
  skipping_ = true;
}

const Pd45Ensemble* Pd45Decoder::next() noexcept {
  while (begin_ < end_) {
    const std::uint8_t* first = buffer_.data() + begin_;
    const std::size_t available = end_ - begin_;
    const auto* found = static_cast<const std::uint8_t*>(std::memchr(first, kHeaderId, available));
    if (found != first) {
      skip(found == nullptr ? available : static_cast<std::size_t>(found - first));
      continue;
    }
    if (available >= 2 && first[1] > 1) {
      skip(1);
      continue;
    }
    if (available < kHeaderBytes) return nullptr;
    const std::size_t size = first[1] == 1 ? kPd5Bytes : kPd4Bytes;
    if (u16(first + 2) != size - kChecksumBytes) {
      skip(1);
      continue;
    }
    if (available < size) return nullptr;
    const std::size_t summed = size - kChecksumBytes;
    const auto sum = static_cast<std::uint16_t>(std::accumulate(first, first + summed, std::uint32_t{0}));
    if (sum != u16(first + summed)) {
      ++counts_.bad_checksum;
      skip(1);
      continue;
    }
    begin_ += size;
    if (skipping_) ++counts_.resynced;
    skipping_ = false;
    ++counts_.good;
    raw_ = {first, size};
    ensemble_ = readEnsemble(raw_);
    return &ensemble_;
  }
  return nullptr;
}

}  // namespace fathom::io
