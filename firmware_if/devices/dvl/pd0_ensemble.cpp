#include "firmware_if/devices/dvl/pd0_ensemble.hpp"

#include <algorithm>
#include <cstddef>
#include <numbers>

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/civil_time.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::uint16_t kFixedLeaderId = 0x0000;
constexpr std::uint16_t kVariableLeaderId = 0x0080;
constexpr std::uint16_t kBottomTrackId = 0x0600;
constexpr double kRadiansPerHundredthDegree = std::numbers::pi / 18000.0;

// The bytes of one data block; a field beyond its end is absent.
class Pd0Block {
 public:
  explicit Pd0Block(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  [[nodiscard]] bool has(std::size_t offset, std::size_t size) const {
    return offset + size <= bytes_.size();
  }
  [[nodiscard]] std::uint8_t u8(std::size_t offset) const { return bytes_[offset]; }
  [[nodiscard]] std::uint16_t u16(std::size_t offset) const {
    return littleEndianAt<std::uint16_t>(bytes_, offset);
  }
  [[nodiscard]] std::int16_t i16(std::size_t offset) const { return static_cast<std::int16_t>(u16(offset)); }
  [[nodiscard]] std::uint32_t u32(std::size_t offset) const {
    return littleEndianAt<std::uint32_t>(bytes_, offset);
  }

 private:
  std::span<const std::uint8_t> bytes_;
};

// Month to hundredths of a second, as both clocks have them behind the year.
std::optional<std::int64_t> pd0ClockToUtc(int year, const Pd0Block& block, std::size_t month_offset) {
  constexpr int kNanosecondsPerHundredth = 10'000'000;
  const int hundredths = block.u8(month_offset + 5);
  if (hundredths > 99) return std::nullopt;
  return utcFromCivil({.year = year,
                       .month = block.u8(month_offset),
                       .day = block.u8(month_offset + 1),
                       .hour = block.u8(month_offset + 2),
                       .minute = block.u8(month_offset + 3),
                       .second = block.u8(month_offset + 4),
                       .nanosecond = hundredths * kNanosecondsPerHundredth});
}

// The clock with a century (offset 57) where the block is long enough and it holds a date, else the older one
// with a two-digit year (offset 4): 80 to 99 are the 1900s, since the format is younger than 1980.
std::optional<std::int64_t> readClock(const Pd0Block& block) {
  constexpr std::size_t kLegacy = 4;
  constexpr std::size_t kWithCentury = 57;
  if (block.has(kWithCentury, 8) && block.u8(kWithCentury) >= 19 && block.u8(kWithCentury) <= 21) {
    const int year = block.u8(kWithCentury) * 100 + block.u8(kWithCentury + 1);
    if (const auto utc = pd0ClockToUtc(year, block, kWithCentury + 2)) return utc;
  }
  if (!block.has(kLegacy, 7)) return std::nullopt;
  const int two_digits = block.u8(kLegacy);
  if (two_digits > 99) return std::nullopt;
  return pd0ClockToUtc(two_digits + (two_digits >= 80 ? 1900 : 2000), block, kLegacy + 1);
}

// Beam angle as the system configuration gives it; code 3 means "other" and leaves it to the leader's own
// byte.
double configuredBeamAngleDeg(std::uint16_t system_configuration) {
  constexpr std::array<double, 4> kAngles = {15, 20, 30, 0};
  return kAngles[(system_configuration >> 8) & 3];
}

bool readFixedLeader(const Pd0Block& block, Pd0Ensemble& out) {
  constexpr std::size_t kBeamAngleOffset = 58;
  if (!block.has(0, 30)) return false;
  out.firmware_version = block.u8(2);
  out.firmware_revision = block.u8(3);
  out.system_configuration = block.u16(4);
  out.up_looking = (out.system_configuration & 0x80) != 0;
  out.beams = block.u8(8);
  out.cells = block.u8(9);
  const std::uint8_t transform = block.u8(25);
  out.frame = static_cast<Pd0Frame>((transform >> 3) & 3);
  out.tilts_used = (transform & 4) != 0;
  out.heading_alignment = block.i16(26) * kRadiansPerHundredthDegree;
  out.heading_bias = block.i16(28) * kRadiansPerHundredthDegree;
  double beam_angle_deg = configuredBeamAngleDeg(out.system_configuration);
  if (block.has(kBeamAngleOffset, 1) && block.u8(kBeamAngleOffset) > 0 && block.u8(kBeamAngleOffset) < 90) {
    beam_angle_deg = block.u8(kBeamAngleOffset);
  }
  out.beam_angle = degreesToRadians(beam_angle_deg);
  return true;
}

bool readVariableLeader(const Pd0Block& block, Pd0Ensemble& out) {
  constexpr std::size_t kPressureOffset = 48;
  if (!block.has(0, 28)) return false;
  out.number = block.u16(2) | (static_cast<std::uint32_t>(block.u8(11)) << 16);
  out.utc_ns = readClock(block);
  if (block.u16(14) != 0 && block.u16(14) != 0xFFFF) out.sound_speed = block.u16(14);
  if (block.u16(18) < 36000) out.heading_deg = block.u16(18) / 100.0;
  if (block.i16(20) != kBadPd0Velocity) out.pitch_deg = block.i16(20) / 100.0;
  if (block.i16(22) != kBadPd0Velocity) out.roll_deg = block.i16(22) / 100.0;
  if (block.u16(24) <= 100) out.salinity = block.u16(24);
  if (block.i16(26) != kBadPd0Velocity) out.temperature_c = block.i16(26) / 100.0;
  if (block.has(kPressureOffset, 4)) {
    out.pressure = static_cast<std::int32_t>(block.u32(kPressureOffset)) * 10.0;  // decapascal on the wire
  }
  return true;
}

std::optional<Pd0BottomTrack> readBottomTrack(const Pd0Block& block) {
  constexpr std::size_t kRangeHighByteOffset = 77;
  if (!block.has(0, 32)) return std::nullopt;
  Pd0BottomTrack out;
  for (std::size_t beam = 0; beam < 4; ++beam) {
    std::uint32_t range_cm = block.u16(16 + 2 * beam);
    if (block.has(kRangeHighByteOffset, 4)) {
      range_cm |= static_cast<std::uint32_t>(block.u8(kRangeHighByteOffset + beam)) << 16;
    }
    if (range_cm != 0) out.range[beam] = range_cm / 100.0;
    const std::int16_t velocity_mm = block.i16(24 + 2 * beam);
    if (velocity_mm != kBadPd0Velocity) out.velocity[beam] = velocity_mm / 1000.0;
    if (block.has(32, 4)) out.correlation[beam] = block.u8(32 + beam);
    if (block.has(40, 4)) out.percent_good[beam] = block.u8(40 + beam);
  }
  return out;
}

}  // namespace

const char* frameName(Pd0Frame frame) {
  constexpr std::array<const char*, 4> kNames = {"beam", "instrument", "ship", "earth"};
  return kNames[static_cast<std::size_t>(frame) & 3];
}

bool Pd0BottomTrack::hasVelocity(Pd0Frame frame) const {
  if (frame != Pd0Frame::kBeam) return velocity[0] && velocity[1] && velocity[2];
  return std::count_if(velocity.begin(), velocity.end(), [](const auto& v) { return v.has_value(); }) >= 3;
}

bool readPd0Ensemble(std::span<const std::uint8_t> bytes, Pd0Ensemble& out) noexcept {
  out = Pd0Ensemble{};
  if (bytes.size() < kPd0HeaderBytes) return false;
  const Pd0Block header(bytes);
  const std::size_t types = header.u8(5);
  if (!header.has(kPd0HeaderBytes, 2 * types)) return false;

  bool fixed_leader = false;
  bool variable_leader = false;
  for (std::size_t i = 0; i < types; ++i) {
    const std::size_t begin = header.u16(kPd0HeaderBytes + 2 * i);
    // A block ends where the next one, in order of offset, begins.
    std::size_t end = bytes.size();
    for (std::size_t k = 0; k < types; ++k) {
      const std::size_t other = header.u16(kPd0HeaderBytes + 2 * k);
      if (other > begin) end = std::min(end, other);
    }
    if (begin + 2 > end) return false;
    const Pd0Block block(bytes.subspan(begin, end - begin));
    const std::uint16_t id = block.u16(0);
    if (id == kFixedLeaderId) fixed_leader = readFixedLeader(block, out);
    if (id == kVariableLeaderId) variable_leader = readVariableLeader(block, out);
    if (id == kBottomTrackId) out.bottom_track = readBottomTrack(block);
  }
  return fixed_leader && variable_leader;
}

}  // namespace fathom::io
