#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "realtime/kernel/rings/fixed_queue.hpp"
#include "recon/geometry/sensor_samples.hpp"

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

  static void exchange(auto& archive, auto& self) {
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

  static void exchange(auto& archive, auto& self) {
    archive.instants(self.utc_ns);
    archive(self.value);
  }
};
struct TimedNumber {
  std::int64_t utc_ns = 0;
  double value = 0;

  static void exchange(auto& archive, auto& self) {
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
[[nodiscard]] std::size_t firstAfter(const auto& queue, std::int64_t utc_ns) noexcept {
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

// A gyro's rate of turn about the body's axes [rad/s]; of a gyro that measures heading alone: 0, 0 and
// the rate of heading.
struct TimedRate {
  std::int64_t utc_ns = 0;
  Eigen::Vector3d value = Eigen::Vector3d::Zero();
  bool heading_only = false;

  static void exchange(auto& archive, auto& self) {
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

// Depth of a body from a pressure sensor p, which swell disturbs, and the DVL's vertical velocity w, which
// swell does not disturb but which drifts when it is summed up: a complementary filter of second order
// (Mahony, Hamel & Pflimlin 2008, the linear case),
//   dz/dt = w + u,   du/dt = omega^2 (p - z) - sqrt(2) omega u,
// so that of swell of the rate s a share (omega / s)^2 is left, and a velocity that is wrong by b leaves
// sqrt(2) b / omega. z and dz/dt never jump. omega follows the swell that is seen: the standard deviation of
// p less the sum of w without what is slower than half a minute, over the last minute. Fixed memory; works in
// steps of any length (backward Euler).
class DepthFilter {
 public:
  void start(double pressure_depth) noexcept;
  // `seconds` later [s], `moved` down by the DVL [m]; then the depth by pressure [m].
  void add(double seconds, double moved, double pressure_depth) noexcept;
  // Without DVL, `moved` being a guess: pressure, nearly at once.
  void addWithoutVelocity(double seconds, double moved, double pressure_depth) noexcept;
  void addWithoutPressure(double moved) noexcept;

  [[nodiscard]] double depth() const noexcept { return depth_; }  // z [m]
  // Pressure's newest depth less z; 0 without pressure [m].
  [[nodiscard]] double pressureOff() const noexcept { return silent_ ? 0 : pressure_ - depth_; }
  // Standard deviation that swell gives a depth by pressure, as seen; 0 in a calm sea [m].
  [[nodiscard]] double sigma() const noexcept;

  static void exchange(auto& archive, auto& self) {
    archive(self.depth_, self.rate_, self.pressure_, self.silent_, self.fast_, self.faster_, self.variance_,
            self.learnt_s_);
  }

 private:
  void learn(double seconds, double change) noexcept;
  void follow(double omega, double seconds, double moved, double pressure_depth) noexcept;

  double depth_ = 0, rate_ = 0;   // z [m], u [m/s]
  double pressure_ = 0;           // newest depth by pressure [m]
  bool silent_ = false;           // there was none since
  double fast_ = 0, faster_ = 0;  // pressure less the velocity's sum, high-pass filtered once, twice [m]
  double variance_ = 0, learnt_s_ = 0;  // of the latter [m^2]; over so long [s]
};

}  // namespace fathom::nav
