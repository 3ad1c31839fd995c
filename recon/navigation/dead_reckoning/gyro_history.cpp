#include "recon/navigation/dead_reckoning/gyro_history.hpp"

#include <algorithm>
#include <cmath>

#include "recon/geometry/se3.hpp"

namespace fathom::nav {
namespace {

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

}  // namespace

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

}  // namespace fathom::nav
