#include "sim/hil/players/dvl_player.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "realtime/base/civil_time.hpp"
#include "realtime/base/units.hpp"

namespace fathom::sim {
namespace {

constexpr std::size_t kPd0HeaderBytes = 6, kTypes = 3, kReserveBytes = 2, kChecksumBytes = 2;
constexpr std::size_t kFixedAt = kPd0HeaderBytes + 2 * kTypes, kFixedBytes = 59;
constexpr std::size_t kVariableAt = kFixedAt + kFixedBytes, kVariableBytes = 65;
constexpr std::size_t kTrackAt = kVariableAt + kVariableBytes, kTrackBytes = 81;
static_assert(kTrackAt + kTrackBytes + kReserveBytes + kChecksumBytes == kPd0EncodedBytes);

constexpr std::int64_t kClockStepNs = 10'000'000;  // of the ensemble's clock
constexpr std::int16_t kBadVelocity = -32768;
constexpr double kBeamAngleDeg = 30;

using Bytes = std::array<std::uint8_t, kPd0EncodedBytes>;

void put16(Bytes& b, std::size_t at, unsigned value) {
  b[at] = static_cast<std::uint8_t>(value & 0xFF);
  b[at + 1] = static_cast<std::uint8_t>((value >> 8) & 0xFF);
}

void putSigned16(Bytes& b, std::size_t at, double value) {
  put16(b, at,
        static_cast<std::uint16_t>(
            static_cast<std::int16_t>(std::lround(std::clamp(value, -32767.0, 32767.0)))));
}

void putFixedLeader(Bytes& b) {
  constexpr unsigned kDownLooking300kHz30Deg = 0x024A;  // convex, 30 degree beams, head attached, looks down
  constexpr unsigned kShipFrameTilts = 0x10 | 0x04;     // transform byte: ship frame, tilts used
  b[kFixedAt + 2] = 51;                                 // firmware 51.40
  b[kFixedAt + 3] = 40;
  put16(b, kFixedAt + 4, kDownLooking300kHz30Deg);
  b[kFixedAt + 8] = 4;  // beams; no cells: bottom track only
  b[kFixedAt + 25] = kShipFrameTilts;
  b[kFixedAt + 58] = static_cast<std::uint8_t>(kBeamAngleDeg);
}

void putClock(Bytes& b, std::int64_t utc_ns) {
  const io::CivilTime t = io::civilFromUtc(utc_ns);
  const auto put = [&](std::size_t at, int value) { b[kVariableAt + at] = static_cast<std::uint8_t>(value); };
  const std::array<int, 6> fields = {t.month,  t.day,    t.hour,
                                     t.minute, t.second, static_cast<int>(t.nanosecond / kClockStepNs)};
  put(4, t.year % 100);
  put(57, t.year / 100);
  put(58, t.year % 100);
  for (std::size_t i = 0; i < fields.size(); ++i) {
    put(5 + i, fields[i]);
    put(59 + i, fields[i]);
  }
}

void putVariableLeader(Bytes& b, const DvlSample& sample, std::uint32_t number, const Pd0Attitude& attitude) {
  constexpr double kFullTurn = 36000;  // hundredths of a degree
  b[kVariableAt] = 0x80;
  put16(b, kVariableAt + 2, number & 0xFFFF);
  putClock(b, roundToPd0Clock(sample.utc_ns));
  b[kVariableAt + 11] = static_cast<std::uint8_t>((number >> 16) & 0xFF);
  put16(b, kVariableAt + 14,
        static_cast<unsigned>(std::lround(std::clamp(sample.sound_speed, 1400.0, 1600.0))));
  const double heading = std::fmod(
      std::fmod(std::round(radiansToDegrees(attitude.heading) * 100), kFullTurn) + kFullTurn, kFullTurn);
  put16(b, kVariableAt + 18, static_cast<unsigned>(heading));
  // The instrument's pitch sensor measures the tilt of its forward axis against gravity, not the Euler angle.
  const double pitch_sensor = std::atan(std::tan(attitude.pitch) / std::cos(attitude.roll));
  putSigned16(b, kVariableAt + 20, radiansToDegrees(pitch_sensor) * 100);
  putSigned16(b, kVariableAt + 22, radiansToDegrees(attitude.roll) * 100);
  put16(b, kVariableAt + 24, 35);    // salinity, parts per thousand
  put16(b, kVariableAt + 26, 2000);  // 20 deg C
}

void putBottomTrack(Bytes& b, const DvlSample& sample) {
  put16(b, kTrackAt, 0x0600);
  put16(b, kTrackAt + 2, 1);  // pings
  const auto good = sample.velocity && sample.velocity->cwiseAbs().maxCoeff() <= 32.767;
  std::array<std::int16_t, 4> v = {kBadVelocity, kBadVelocity, kBadVelocity, kBadVelocity};
  if (good) {
    // The bottom's velocity, starboard, forward, mast.
    const Eigen::Vector3d& u = *sample.velocity;
    const std::array<double, 3> bottom = {-u.y(), -u.x(), u.z()};
    for (std::size_t i = 0; i < bottom.size(); ++i)
      v[i] = static_cast<std::int16_t>(std::lround(bottom[i] * 1000));
    v[3] = 0;  // error velocity
  }
  for (std::size_t beam = 0; beam < 4; ++beam) {
    const double metres = sample.range[beam].value_or(0);
    const auto cm = static_cast<std::uint32_t>(std::clamp(std::lround(metres * 100), 0L, 0xFFFFFFL));
    put16(b, kTrackAt + 16 + 2 * beam, cm & 0xFFFF);
    b[kTrackAt + 77 + beam] = static_cast<std::uint8_t>(cm >> 16);
    put16(b, kTrackAt + 24 + 2 * beam, static_cast<std::uint16_t>(v[beam]));
    const bool received = sample.range[beam].has_value();
    b[kTrackAt + 32 + beam] = received ? 220 : 0;  // correlation
    b[kTrackAt + 36 + beam] = received ? 90 : 0;   // evaluation amplitude
    b[kTrackAt + 40 + beam] = received ? 100 : 0;  // per cent good
  }
}

constexpr std::int64_t kByteNs = 10 * kSecond_ns / DvlPlayer::kBaud;  // start bit, eight, stop bit
constexpr std::size_t kChunkBytes = 32;  // written at once, as by a UART's driver
constexpr std::uint8_t kHeaderByte = 0x7F;

// Arrival time of the last byte; the first is not sent before the measurement.
std::int64_t dueTime(const ScheduledSample& scheduled) {
  constexpr std::int64_t kLineNs = static_cast<std::int64_t>(kPd0EncodedBytes) * kByteNs;
  return std::max(scheduled.due_utc_ns, std::get<DvlSample>(scheduled.sample).utc_ns + kLineNs);
}

// Random bytes without the header byte, so that the count of damaged ensembles is exact.
void appendNoise(std::vector<std::uint8_t>& out, int bytes, std::mt19937& random) {
  for (int i = 0; i < bytes; ++i) {
    const auto byte = static_cast<std::uint8_t>(random());
    out.push_back(byte == kHeaderByte ? 0 : byte);
  }
}

}  // namespace

std::int64_t roundToPd0Clock(std::int64_t utc_ns) {
  std::int64_t rest = utc_ns % kClockStepNs;
  if (rest < 0) rest += kClockStepNs;
  return utc_ns - rest + (2 * rest >= kClockStepNs ? kClockStepNs : 0);
}

std::array<std::uint8_t, kPd0EncodedBytes> encodePd0(const DvlSample& sample, std::uint32_t number,
                                                     const Pd0Attitude& attitude) {
  Bytes b{};
  b[0] = b[1] = 0x7F;
  put16(b, 2, kPd0EncodedBytes - kChecksumBytes);
  b[5] = kTypes;
  put16(b, kPd0HeaderBytes, kFixedAt);
  put16(b, kPd0HeaderBytes + 2, kVariableAt);
  put16(b, kPd0HeaderBytes + 4, kTrackAt);
  putFixedLeader(b);
  putVariableLeader(b, sample, number, attitude);
  putBottomTrack(b, sample);
  unsigned sum = 0;
  for (std::size_t i = 0; i + kChecksumBytes < b.size(); ++i) sum += b[i];
  put16(b, kPd0EncodedBytes - kChecksumBytes, sum & 0xFFFF);
  return b;
}

DvlPlayer::DvlPlayer(const MissionSchedule& schedule, const FaultScript& script, SimulatedVehicleClock& clock,
                     Line line)
    : schedule_(schedule), script_(script), clock_(clock), line_(std::move(line)) {}

double DvlPlayer::latency() const {
  std::int64_t least_ns = std::numeric_limits<std::int64_t>::max();
  for (const ScheduledSample& s : schedule_.samples)
    if (const auto* dvl = std::get_if<DvlSample>(&s.sample))
      least_ns = std::min(least_ns,
                          dueTime(s) - static_cast<std::int64_t>(kPd0EncodedBytes) * kByteNs - dvl->utc_ns);
  // The first chunk arrives with its last byte.
  least_ns += static_cast<std::int64_t>(kChunkBytes) * kByteNs;
  return std::max(0.0, static_cast<double>(least_ns) * 1e-9);
}

bool DvlPlayer::send(std::span<const std::uint8_t> bytes, std::int64_t begin_ns,
                     const std::atomic<bool>& stop) {
  for (std::size_t at = 0; at < bytes.size(); at += kChunkBytes) {
    const std::size_t size = std::min(kChunkBytes, bytes.size() - at);
    // A chunk arrives with its last bit.
    if (!clock_.sleepUntil(begin_ns + static_cast<std::int64_t>(at + size) * kByteNs, stop)) return false;
    line_(bytes.subspan(at, size));
  }
  return true;
}

void DvlPlayer::run(const std::atomic<bool>& stop) {
  std::mt19937 random(1);  // of the noise bytes, which have no effect on results
  Pd0Attitude attitude;
  std::uint32_t number = 0;
  const Fault* garbage = nullptr;
  std::int64_t in_garbage = 0;  // ensembles since it began
  std::vector<std::uint8_t> bytes;
  for (const ScheduledSample& scheduled : schedule_.samples) {
    if (const auto* a = std::get_if<AttitudeSample>(&scheduled.sample)) {
      attitude = {a->heading, a->pitch, a->roll};
      continue;
    }
    const auto* sample = std::get_if<DvlSample>(&scheduled.sample);
    if (sample == nullptr) continue;
    ++number;
    const double mission_s = schedule_.missionSeconds(scheduled.due_utc_ns);
    if (script_.at(FaultKind::kDvlSilence, mission_s) != nullptr) {
      ++counters_.withheld;
      continue;
    }
    auto ensemble = encodePd0(*sample, number, attitude);
    bytes.clear();
    const Fault* fault = script_.at(FaultKind::kDvlGarbage, mission_s);
    if (fault != garbage) in_garbage = 0;
    garbage = fault;
    if (fault != nullptr && in_garbage++ % fault->every == 0) {
      appendNoise(bytes, fault->noise_bytes, random);
      // Damages a data byte and keeps the header, so that the checksum detects it.
      ensemble[kPd0FirstBlock + random() % (ensemble.size() - kPd0FirstBlock - 2)] ^= 0x55;
      ++counters_.damaged;
    }
    bytes.insert(bytes.end(), ensemble.begin(), ensemble.end());
    const std::int64_t begin_ns = dueTime(scheduled) - static_cast<std::int64_t>(bytes.size()) * kByteNs;
    if (!clock_.sleepUntil(begin_ns, stop)) return;
    counters_.worst_late_ns = std::max(counters_.worst_late_ns, clock_.utcNs() - begin_ns);
    if (!send(bytes, begin_ns, stop)) return;
    ++counters_.ensembles;
  }
}

}  // namespace fathom::sim
