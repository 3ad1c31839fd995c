#include "recon/navigation/dead_reckoning/sensor_history.hpp"

#include <algorithm>

#include "realtime/base/units.hpp"

namespace fathom::nav {
namespace {

// Longest silence after which the next stamp is taken at once, unless the sensor is known to be slower.
constexpr std::int64_t kMaxLeapNs = 5'000'000'000;
constexpr std::int64_t kMinSilenceNs = kSecond_ns;
constexpr std::int64_t kSilentPeriods = 3;

// Stamps are between 1970 and 2116; others are damaged, and would overflow differences.
constexpr std::int64_t kLatestUtcNs = std::int64_t{1} << 62;

// Position of `utc_ns` between a's time and b's, 0 to 1.
template <typename Timed>
double fraction(const Timed& a, const Timed& b, std::int64_t utc_ns) noexcept {
  return static_cast<double>(utc_ns - a.utc_ns) / static_cast<double>(b.utc_ns - a.utc_ns);
}

}  // namespace

bool TimeGate::leaps(std::int64_t from, std::int64_t to) const noexcept {
  return to - from > (intervals_.empty() ? kMaxLeapNs : std::max(kMaxLeapNs, silence_ns_));
}

void TimeGate::learnInterval(std::int64_t interval_ns) noexcept {
  intervals_.pushDroppingOldest(interval_ns);
  std::int64_t longest = 0, second = 0;
  for (std::size_t i = 0; i < intervals_.size(); ++i) {
    second = std::max(second, std::min(longest, intervals_[i]));
    longest = std::max(longest, intervals_[i]);
  }
  const std::int64_t period = std::min(intervals_.size() == 1 ? longest : second, kMaxSilenceNs);
  silence_ns_ = std::clamp(kSilentPeriods * period, kMinSilenceNs, kMaxSilenceNs);
}

TimeCheck TimeGate::check(std::int64_t utc_ns) noexcept {
  if (utc_ns <= 0 || utc_ns > kLatestUtcNs) return TimeCheck::kImpossible;
  if (any_ && utc_ns <= newest_) return TimeCheck::kOutOfOrder;
  if (any_ && leaps(newest_, utc_ns)) {
    const bool confirmed = leap_ && utc_ns > *leap_ && !leaps(*leap_, utc_ns);
    leap_ = utc_ns;
    if (!confirmed) return TimeCheck::kLeap;
  }
  leap_.reset();
  if (any_) learnInterval(utc_ns - newest_);
  newest_ = utc_ns;
  any_ = true;
  return TimeCheck::kGood;
}

Eigen::Quaterniond rotationAt(const RotationHistory& history, std::int64_t utc_ns) noexcept {
  const std::size_t after = firstAfter(history, utc_ns);
  if (after == 0) return history.front().value;
  if (after == history.size()) return history.back().value;
  const TimedRotation& a = history[after - 1];
  const TimedRotation& b = history[after];
  return a.value.slerp(fraction(a, b, utc_ns), b.value);
}

double numberAt(const NumberHistory& history, std::int64_t utc_ns) noexcept {
  const std::size_t after = firstAfter(history, utc_ns);
  if (after == 0) return history.front().value;
  if (after == history.size()) return history.back().value;
  const TimedNumber& a = history[after - 1];
  const TimedNumber& b = history[after];
  return a.value + (b.value - a.value) * fraction(a, b, utc_ns);
}

}  // namespace fathom::nav
