#include "sim/hil/players/dvl_player.hpp"

#include <algorithm>
#include <limits>
#include <random>

#include "realtime/base/units.hpp"
#include "sim/hil/players/pd0_encoder.hpp"

namespace fathom::sim {
namespace {

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
