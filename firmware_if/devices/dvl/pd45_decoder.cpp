#include "firmware_if/devices/dvl/pd45_decoder.hpp"

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::uint8_t kPd45HeaderId = 0x7D;
constexpr std::size_t kPd45HeaderBytes = 4;
constexpr std::int64_t kDay_ns = 86'400 * kSecond_ns;

// Structure (0: PD4, 1: PD5) and length without the checksum.
EnsembleStream::Header readPd45Header(std::span<const std::uint8_t> bytes, std::size_t) noexcept {
  using State = EnsembleStream::Header::State;
  if (bytes.size() >= 2 && bytes[1] > 1) return {};
  if (bytes.size() < kPd45HeaderBytes) return {State::kIncomplete};
  const std::size_t size = bytes[1] == 1 ? Pd45Decoder::kPd5Bytes : Pd45Decoder::kPd4Bytes;
  if (littleEndianAt<std::uint16_t>(bytes, 2) != size - EnsembleStream::kChecksumBytes) return {};
  return {State::kPossible, size};
}

// Byte offsets from the start of the ensemble (the guide counts from 1).
Pd45Ensemble readPd45Ensemble(std::span<const std::uint8_t> b) {
  const auto u16 = [b](std::size_t at) { return littleEndianAt<std::uint16_t>(b, at); };
  const auto i16 = [b](std::size_t at) {
    return static_cast<std::int16_t>(littleEndianAt<std::uint16_t>(b, at));
  };
  Pd45Ensemble out;
  out.pd5 = b[1] == 1;
  out.frame = static_cast<Pd0Frame>(b[4] >> 6);
  out.tilts_used = (b[4] & 0x20) != 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::int16_t velocity_mm = i16(5 + 2 * i);
    if (velocity_mm != kBadPd0Velocity) out.velocity[i] = velocity_mm / 1000.0;
    const std::uint16_t range_cm = u16(13 + 2 * i);
    if (range_cm != 0) out.range[i] = range_cm / 100.0;
  }
  const int hour = b[35], minute = b[36], second = b[37], hundredth = b[38];
  if (hour < 24 && minute < 60 && second < 60 && hundredth < 100)
    out.time_of_day_ns = ((hour * 60 + minute) * 60 + second) * kSecond_ns + hundredth * (kSecond_ns / 100);
  if (u16(41) != 0 && u16(41) != 0xFFFF) out.sound_speed = u16(41);
  if (i16(43) != kBadPd0Velocity) out.temperature_c = i16(43) / 100.0;
  if (!out.pd5) return out;
  if (i16(48) != kBadPd0Velocity) out.pitch_deg = i16(48) / 100.0;
  if (i16(50) != kBadPd0Velocity) out.roll_deg = i16(50) / 100.0;
  if (u16(52) < 36000) out.heading_deg = u16(52) / 100.0;
  return out;
}

}  // namespace

Pd0Ensemble toPd0(const Pd45Ensemble& ensemble, std::int64_t near_utc_ns) {
  Pd0Ensemble out;
  out.frame = ensemble.frame;
  out.tilts_used = ensemble.tilts_used;
  out.beams = 4;
  if (ensemble.time_of_day_ns) {
    // The day on which this time of day is less than half a day away.
    const std::int64_t since = near_utc_ns - kDay_ns / 2 - *ensemble.time_of_day_ns;
    const std::int64_t days = since / kDay_ns + (since % kDay_ns > 0 ? 1 : 0);
    out.utc_ns = days * kDay_ns + *ensemble.time_of_day_ns;
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

Pd45Decoder::Pd45Decoder() : stream_(kPd45HeaderId, kPd5Bytes, readPd45Header) {}

const Pd45Ensemble* Pd45Decoder::next() noexcept {
  const auto found = stream_.next();
  if (found.empty()) return nullptr;
  ++stream_.counts().good;
  raw_ = found;
  ensemble_ = readPd45Ensemble(raw_);
  return &ensemble_;
}

}  // namespace fathom::io
