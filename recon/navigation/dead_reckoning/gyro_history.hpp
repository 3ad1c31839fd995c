#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>

#include "realtime/kernel/rings/fixed_queue.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/navigation/dead_reckoning/sensor_history.hpp"

namespace fathom::nav {

// A gyro's rate of turn about the body's axes [rad/s]; of a gyro that measures heading alone: 0, 0 and
// the rate of heading.
struct TimedRate {
  std::int64_t utc_ns = 0;
  Eigen::Vector3d value = Eigen::Vector3d::Zero();
  bool heading_only = false;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.instants(self.utc_ns);
    archive(self.value, self.heading_only);
  }
};
inline constexpr std::size_t kRates = 2048;  // 10 s at 200 Hz: the longest silence that is waited for
using RateHistory = rt::FixedQueue<TimedRate, kRates>;

// From a sample; `R_body_gyro` turns the gyro's axes into the body's. None when it holds no rate, or one that
// no vehicle has (above 10 rad/s), or is not a number.
[[nodiscard]] std::optional<TimedRate> bodyRate(const GyroSample& sample,
                                                const Eigen::Quaterniond& R_body_gyro) noexcept;

// d heading / dt of a body with roll phi and pitch theta (Fossen, "Handbook of Marine Craft Hydrodynamics and
// Motion Control", 2011, eq. 2.26):  psi_dot = (q sin phi + r cos phi) / cos theta.
[[nodiscard]] double headingRate(const TimedRate& rate, const Eigen::Quaterniond& R_odom_body) noexcept;

// Rate of heading at a time [rad/s], the gyro's rates linear between its samples; 0 where it is silent:
// outside its samples, and between two that are more than `max_gap_ns` apart.
[[nodiscard]] double headingRateAt(const RateHistory& rates, const RotationHistory& attitudes,
                                   std::int64_t utc_ns, std::int64_t max_gap_ns) noexcept;

// Turn about odom's down axis from one time to another [rad], by trapezoids at the gyro's samples, and for
// how long of that it was silent [s], which adds nothing to the turn.
struct GyroTurn {
  double angle = 0, silent_s = 0;
};
[[nodiscard]] GyroTurn turnBetween(const RateHistory& rates, const RotationHistory& attitudes,
                                   std::int64_t from, std::int64_t to, std::int64_t max_gap_ns) noexcept;

}  // namespace fathom::nav
