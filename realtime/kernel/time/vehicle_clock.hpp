#pragma once

#include <cstdint>
#include <optional>

#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::rt {

// Where vehicle time begins when the program starts.
struct ClockStart {
  std::int64_t offset_ns = 0;  // UTC less the monotonic clock
  // How far the intended clock was behind the log's end; vehicle time then continues from that end. 0: not
  // behind.
  std::int64_t behind_ns = 0;
};
// `kept_offset_ns`: the offset of an earlier run since the machine booted, which is kept so that no sample
// moves; absent: the system's. `last_ns`: the newest arrival in the dive's log, 0 for a new dive. Within a
// dive time never runs backwards or stands still: it begins after that arrival, a millisecond later where the
// clock is behind it.
[[nodiscard]] constexpr ClockStart beginVehicleTime(std::int64_t system_offset_ns,
                                                    std::optional<std::int64_t> kept_offset_ns,
                                                    std::int64_t monotonic_ns,
                                                    std::int64_t last_ns) noexcept {
  constexpr std::int64_t kBehindLast = kMillisecond_ns;  // [ns]
  ClockStart start{kept_offset_ns.value_or(system_offset_ns), 0};
  const std::int64_t now_ns = monotonic_ns + start.offset_ns;
  if (last_ns == 0 || now_ns > last_ns) return start;
  start.behind_ns = last_ns + kBehindLast - now_ns;
  start.offset_ns += start.behind_ns;
  return start;
}

// The vehicle's time: the monotonic clock plus an offset to UTC that is fixed at arming and kept when the
// program starts again on the same machine. Setting the system's clock during a dive moves no sample. Add
// utcErrorNs() to a stamp of another program in the system's UTC to get vehicle time.
class VehicleClock final : public Clock {
 public:
  // `offset_ns`: UTC less the monotonic clock. `rate`: seconds of both clocks per second of the machine's,
  // for tests that play a mission faster; 1 on a vehicle.
  explicit VehicleClock(std::int64_t offset_ns, double rate = 1) noexcept
      : VehicleClock(offset_ns, rate, nullptr) {}
  // By another clock than the machine's, which must outlive it.
  VehicleClock(std::int64_t offset_ns, Clock& machine) noexcept : VehicleClock(offset_ns, 1, &machine) {}
  VehicleClock(const VehicleClock&) = delete;
  VehicleClock& operator=(const VehicleClock&) = delete;
  // Parameters that make the same clock in another process.
  struct Setting {
    std::int64_t offset_ns = 0;
    double rate = 1;
    std::int64_t begin_ns = 0;
  };
  explicit VehicleClock(const Setting& setting) noexcept
      : VehicleClock(setting.offset_ns, setting.rate, nullptr) {
    begin_ns_ = setting.begin_ns;
  }
  [[nodiscard]] Setting setting() const noexcept { return {offset_ns_, rate_, begin_ns_}; }

  [[nodiscard]] static std::int64_t systemOffsetNs() noexcept { return offsetOf(RealClock()); }

  [[nodiscard]] std::int64_t monotonicNs() const noexcept override { return scaled(machine_.monotonicNs()); }
  [[nodiscard]] std::int64_t utcNs() const noexcept override { return monotonicNs() + offset_ns_; }
  void sleepUntil(std::int64_t monotonic_ns) noexcept override {
    if (rate_ != 1)
      monotonic_ns =
          begin_ns_ + static_cast<std::int64_t>(static_cast<double>(monotonic_ns - begin_ns_) / rate_);
    machine_.sleepUntil(monotonic_ns);
  }
  // By how much the system's clock has been set since this clock was made [ns].
  [[nodiscard]] std::int64_t systemStepNs() const noexcept {
    return rate_ == 1 ? offsetOf(machine_) - system_offset_ns_ : 0;
  }
  // Vehicle time less the system's present UTC [ns]. ClockState has whether that UTC is right.
  [[nodiscard]] std::int64_t utcErrorNs() const noexcept {
    return rate_ == 1 ? offset_ns_ - offsetOf(machine_) : 0;
  }

 private:
  VehicleClock(std::int64_t offset_ns, double rate, Clock* machine) noexcept
      : machine_(machine != nullptr ? *machine : real_),
        offset_ns_(offset_ns),
        system_offset_ns_(offsetOf(machine_)),
        rate_(rate),
        begin_ns_(machine_.monotonicNs()) {}
  // Best of a few readings of UTC between two of the monotonic clock: the thread may be preempted in between.
  [[nodiscard]] static std::int64_t offsetOf(const Clock& clock) noexcept {
    constexpr int kReadings = 3;
    std::int64_t offset_ns = 0, closest_ns = INT64_MAX;
    for (int i = 0; i < kReadings; ++i) {
      const std::int64_t before_ns = clock.monotonicNs(), utc_ns = clock.utcNs();
      const std::int64_t took_ns = clock.monotonicNs() - before_ns;
      if (took_ns >= closest_ns) continue;
      closest_ns = took_ns;
      offset_ns = utc_ns - before_ns - took_ns / 2;
    }
    return offset_ns;
  }
  [[nodiscard]] std::int64_t scaled(std::int64_t machine_ns) const noexcept {
    if (rate_ == 1) return machine_ns;
    return begin_ns_ + static_cast<std::int64_t>(static_cast<double>(machine_ns - begin_ns_) * rate_);
  }

  RealClock real_;
  Clock& machine_;
  std::int64_t offset_ns_, system_offset_ns_;
  double rate_;
  std::int64_t begin_ns_;  // of the machine's clock
};

// The vehicle's time against UTC as the machine knows it.
struct ClockState {
  bool synchronised = false;  // the system's clock is disciplined: its UTC is right
  std::int64_t error_ns = 0;  // vehicle time less the system's UTC
};
// Asks the kernel (half a microsecond): on any thread but the hard tier's.
[[nodiscard]] inline ClockState clockState(const VehicleClock& clock) noexcept {
  return {readSystemClock().synchronised, clock.utcErrorNs()};
}

// Whether the ship can take vehicle time for UTC. Unsure as long as the system's clock has never been
// synchronised, and if vehicle time was more than a second off when it last was. Does not influence vehicle
// time. One thread.
class ClockHealth {
 public:
  static constexpr std::int64_t kMostErrorNs = kSecond_ns;

  void look(const ClockState& state) noexcept {
    if (!state.synchronised) return;
    known_ = true;
    error_ns_ = state.error_ns;
  }
  [[nodiscard]] bool unsure() const noexcept {
    return !known_ || error_ns_ > kMostErrorNs || error_ns_ < -kMostErrorNs;
  }

 private:
  bool known_ = false;
  std::int64_t error_ns_ = 0;  // when the system's clock was last seen synchronised
};

}  // namespace fathom::rt
