#include "recon/navigation/dead_reckoning/sensor_history.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/se3.hpp"

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

constexpr double kFastestTurn = 10;        // of any vehicle [rad/s]
constexpr double kLeastCosinePitch = 0.1;  // nearer the vertical a heading means nothing

// Whether the gyro spoke on both sides of a time, close enough to stand for it.
bool coveredAt(const RateHistory& rates, std::size_t after, std::int64_t max_gap_ns) noexcept {
  return after > 0 && after < rates.size() && rates[after].utc_ns - rates[after - 1].utc_ns <= max_gap_ns;
}

double rateWithin(const RateHistory& rates, const RotationHistory& attitudes, std::size_t after,
                  std::int64_t utc_ns) noexcept {
  const TimedRate &a = rates[after - 1], &b = rates[after];
  const double share = static_cast<double>(utc_ns - a.utc_ns) / static_cast<double>(b.utc_ns - a.utc_ns);
  const TimedRate between{utc_ns, a.value + share * (b.value - a.value), b.heading_only};
  return headingRate(between, rotationAt(attitudes, utc_ns));
}

constexpr double kCalmRate = 0.8;    // omega in a calm sea [rad/s]: a velocity wrong by 2 mm/s leaves 4 mm
constexpr double kCalm = 0.005;      // noise of depth and velocity in a calm sea, at most [m]
constexpr double kPressureRate = 3;  // omega where pressure is all there is [rad/s]
constexpr double kHighPass_s = 5;    // time constant: swell of 20 s still passes by 0.7
constexpr double kMemory_s = 60;     // of the variance: a few groups of waves
constexpr double kFirst_s = 10;      // until then all is taken as it is
constexpr double kOutlier = 3;       // standard deviations that one reading counts for at most

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

std::optional<TimedRate> bodyRate(const GyroSample& sample, const Eigen::Quaterniond& R_body_gyro) noexcept {
  TimedRate rate;
  rate.utc_ns = sample.utc_ns;
  if (sample.body_rate) {
    rate.value = R_body_gyro * *sample.body_rate;
  } else if (sample.heading_rate) {
    rate.value.z() = *sample.heading_rate;
    rate.heading_only = true;
  } else {
    return std::nullopt;
  }
  if (!(rate.value.norm() <= kFastestTurn)) return std::nullopt;  // also what is not a number
  return rate;
}

double headingRate(const TimedRate& rate, const Eigen::Quaterniond& R_odom_body) noexcept {
  if (rate.heading_only) return rate.value.z();
  // The last row of R_odom_body is (-sin theta, sin phi cos theta, cos phi cos theta).
  const Eigen::Vector3d down = R_odom_body.conjugate() * Eigen::Vector3d::UnitZ();
  const double cosine2 = down.y() * down.y() + down.z() * down.z();
  return (rate.value.y() * down.y() + rate.value.z() * down.z()) /
         std::max(cosine2, kLeastCosinePitch * kLeastCosinePitch);
}

double headingRateAt(const RateHistory& rates, const RotationHistory& attitudes, std::int64_t utc_ns,
                     std::int64_t max_gap_ns) noexcept {
  if (!rates.empty() && utc_ns == rates.back().utc_ns)
    return headingRate(rates.back(), rotationAt(attitudes, utc_ns));
  const std::size_t after = firstAfter(rates, utc_ns);
  return coveredAt(rates, after, max_gap_ns) ? rateWithin(rates, attitudes, after, utc_ns) : 0.0;
}

GyroTurn turnBetween(const RateHistory& rates, const RotationHistory& attitudes, std::int64_t from,
                     std::int64_t to, std::int64_t max_gap_ns) noexcept {
  GyroTurn turn;
  for (std::size_t after = firstAfter(rates, from); from < to; ++after) {
    const bool last = after >= rates.size();
    const std::int64_t until = last ? to : std::min(to, rates[after].utc_ns);
    const double span = static_cast<double>(until - from) * 1e-9;
    if (coveredAt(rates, after, max_gap_ns))
      turn.angle += 0.5 * span *
                    (rateWithin(rates, attitudes, after, from) + rateWithin(rates, attitudes, after, until));
    else
      turn.silent_s += span;
    from = until;
  }
  return turn;
}

void DepthFilter::start(double pressure_depth) noexcept {
  *this = {};
  depth_ = pressure_ = pressure_depth;
}

double DepthFilter::sigma() const noexcept {
  return std::sqrt(std::max(variance_ - kCalm * kCalm, 0.0));
}

void DepthFilter::add(double seconds, double moved, double pressure_depth) noexcept {
  if (!silent_) learn(seconds, pressure_depth - pressure_ - moved);
  follow(kCalmRate * std::sqrt(kCalm / hypotenuse(sigma(), kCalm)), seconds, moved, pressure_depth);
}

void DepthFilter::addWithoutVelocity(double seconds, double moved, double pressure_depth) noexcept {
  follow(kPressureRate, seconds, moved, pressure_depth);
}

void DepthFilter::addWithoutPressure(double moved) noexcept {
  depth_ += moved;
  rate_ = 0;
  silent_ = true;
}

// `change` of pressure less the velocity's sum. A velocity that is wrong for a while gives a slow change,
// which the second filter leaves little of, and one that is an outlier counts for no more than an outlier.
void DepthFilter::learn(double seconds, double change) noexcept {
  const double keeps = kHighPass_s / (kHighPass_s + seconds);
  const double before = fast_;
  fast_ = keeps * (fast_ + change);
  faster_ = keeps * (faster_ + fast_ - before);
  const double most = kOutlier * kOutlier * (variance_ + kCalm * kCalm);
  const double square = learnt_s_ < kFirst_s ? faster_ * faster_ : std::min(faster_ * faster_, most);
  learnt_s_ = std::min(learnt_s_ + seconds, kMemory_s);
  variance_ += std::min(seconds / learnt_s_, 1.0) * (square - variance_);
}

void DepthFilter::follow(double omega, double seconds, double moved, double pressure_depth) noexcept {
  const double damping = std::numbers::sqrt2 * omega * seconds, stiffness = omega * omega * seconds;
  rate_ = (rate_ + stiffness * (pressure_depth - depth_ - moved)) / (1 + damping + stiffness * seconds);
  depth_ += moved + rate_ * seconds;
  pressure_ = pressure_depth;
  silent_ = false;
}

}  // namespace fathom::nav
