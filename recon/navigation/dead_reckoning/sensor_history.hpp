#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "realtime/kernel/rings/fixed_queue.hpp"

namespace fathom::nav {

enum class TimeCheck : std::uint8_t { kGood, kOutOfOrder, kLeap, kImpossible };

// Watches the time stamps of one sensor. Times must grow. A leap ahead is accepted only when the next stamp
// agrees with it: one damaged stamp is dropped, a real gap costs one sample.
//
// A sensor is silent after three of its periods without a sample, between one second and ten. The period is
// the second longest of its last intervals, so that neither a lost sample nor an outage counts. Before its
// second sample: ten seconds.
class TimeGate {
 public:
  [[nodiscard]] TimeCheck check(std::int64_t utc_ns) noexcept;
  [[nodiscard]] bool any() const noexcept { return any_; }
  [[nodiscard]] std::int64_t newestUtcNs() const noexcept { return newest_; }
  [[nodiscard]] std::int64_t silenceNs() const noexcept { return silence_ns_; }
  [[nodiscard]] bool silentAt(std::int64_t utc_ns) const noexcept { return utc_ns - newest_ > silence_ns_; }

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.instants(self.newest_);
    archive(self.leap_, self.any_, self.intervals_, self.silence_ns_);
    archive.require(self.silence_ns_ > 0 && self.silence_ns_ <= kMaxSilenceNs, "a silence too long");
    if (self.leap_)
      archive.require(*self.leap_ > 0 && *self.leap_ < std::int64_t{1} << 62, "a stamp too far");
  }

 private:
  std::int64_t newest_ = 0;
  std::optional<std::int64_t> leap_;  // a stamp far ahead that waits for its successor
  bool any_ = false;
  static constexpr std::int64_t kMaxSilenceNs = 10'000'000'000;
  static constexpr std::size_t kIntervals = 8;
  [[nodiscard]] bool leaps(std::int64_t from, std::int64_t to) const noexcept;
  void learnInterval(std::int64_t interval_ns) noexcept;
  rt::FixedQueue<std::int64_t, kIntervals> intervals_;  // the newest [ns]
  std::int64_t silence_ns_ = kMaxSilenceNs;
};

struct TimedRotation {
  std::int64_t utc_ns = 0;
  Eigen::Quaterniond value = Eigen::Quaterniond::Identity();

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.instants(self.utc_ns);
    archive(self.value);
  }
};
struct TimedNumber {
  std::int64_t utc_ns = 0;
  double value = 0;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.instants(self.utc_ns);
    archive(self.value);
  }
};

inline constexpr std::size_t kSensorHistory = 1024;  // samples: 20 s at 50 Hz
using RotationHistory = rt::FixedQueue<TimedRotation, kSensorHistory>;
using NumberHistory = rt::FixedQueue<TimedNumber, kSensorHistory>;

// Value at a time: slerp or linear between the neighbours; before the oldest and after the newest, that one.
// The history must not be empty.
[[nodiscard]] Eigen::Quaterniond rotationAt(const RotationHistory& history, std::int64_t utc_ns) noexcept;
[[nodiscard]] double numberAt(const NumberHistory& history, std::int64_t utc_ns) noexcept;

// Position of the first element later than `utc_ns` in a queue ordered by time; its size when there is none.
template <typename Queue>
[[nodiscard]] std::size_t firstAfter(const Queue& queue, std::int64_t utc_ns) noexcept {
  std::size_t low = 0, high = queue.size();
  while (low < high) {
    const std::size_t middle = (low + high) / 2;
    if (queue[middle].utc_ns > utc_ns)
      high = middle;
    else
      low = middle + 1;
  }
  return low;
}

}  // namespace fathom::nav
