#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/kernel/rings/fixed_queue.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/sea_water.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/navigation/dead_reckoning/sensor_history.hpp"

namespace fathom::nav {

struct DeadReckoningConfig {
  SE3 T_body_dvl, T_body_depth, T_body_compass;
  double magnetic_declination = 0;  // [rad], east positive
  // Of nav's origin, which odom's is taken to be near: compasses give true north, which differs from nav's
  // north towards the east and west (meridianConvergence) [rad].
  double origin_latitude = 0;
  // True speed of sound at the DVL until the first water sample [m/s]; none: that of the instrument.
  std::optional<double> sound_speed;
  bool phased_array = false;   // of the DVL: horizontal velocities do not depend on the speed of sound
  double max_dvl_gap = 2.0;    // without bottom track longer than this the velocity decays to zero [s]
  double max_speed = 3.0;      // faster bottom-track velocities are rejected [m/s]
  std::optional<Tide> tide;    // predicted, taken out of depths
  double max_turn_rate = 1.0;  // a heading that turns faster has leapt: twice any survey vehicle's [rad/s]
};

// Odometry from DVL, attitude and depth: T_odom_body. odom is North-East-Down
// with its origin above (on the surface) the point where dead reckoning began;
// depth is absolute. Smooth, never jumps; allocates nothing after construction.
//
// The position of the DVL, not of the body, is integrated, so that the lever arm r (DVL in body) needs no
// rate of turn:  d p_dvl / dt = R_odom_body R_body_dvl v c_true / c_assumed,   p_body = p_dvl - R_odom_body
// r, with v linear in time between ensembles, R from the compass (slerp between samples), trapezoids at every
// attitude and depth sample in between. The factor corrects the sound speed that the instrument assumed:
// velocities and ranges are proportional to it (RD Instruments, "ADCP Principles of Operation", 1996, "Sound
// speed corrections"), but for the horizontal velocities of a phased array, which are right at any speed
// because the angle of its beams changes with it. c_true is the newest water sample's, else the config's,
// else the instrument's own, which it may compute from its thermometer: then the factor is 1, and Quality
// says how wrong the scale may be. Depth is the pressure sensor's, less its lever arm and the predicted tide,
// and in a swell the DVL's over seconds (DepthFilter).
//
// An ensemble is used once attitude and depth reach its time, so poses up to newestUtcNs() are final. A
// sensor silent for longer than its rate explains (TimeGate) is not waited for: attitude is held, depth
// follows the DVL's vertical velocity and, when the sensor is back, closes the difference over seconds.
//
// A compass that leaps (current in a cable, steel nearby) must not bend the track: the leap is removed from
// all later headings, so that odometry continues smoothly and the error of its heading does not grow. SLAM,
// which knows the heading better, receives it by counters().
//
// A gyro turns nothing here: its rate of heading is summed up beside the track and given to SLAM by
// qualityAt(), to be compared with the compass.
class DeadReckoning {
 public:
  // The numbers of the config must be finite, the speeds and the gap positive (the mission's reader checks).
  explicit DeadReckoning(const DeadReckoningConfig& config);

  void add(const DvlSample& sample) noexcept;
  void add(const AttitudeSample& sample) noexcept;
  void add(const GyroSample& sample) noexcept;
  void add(const DepthSample& sample) noexcept;
  void add(const WaterSample& sample) noexcept;

  // Needs attitude, depth and one bottom-track velocity.
  [[nodiscard]] bool initialised() const noexcept { return !nodes_.empty(); }
  // Pose at a time within the kept history (20 s), interpolated; up to a second beyond the newest, or as long
  // as a slower sensor may be waited for: extrapolated.
  [[nodiscard]] std::optional<SE3> poseAt(std::int64_t utc_ns) const noexcept;
  // The same, but beyond the newest final pose by the velocities that still wait, then by the newest one and
  // the rate of turn, up to a second beyond the newest samples of DVL and compass.
  [[nodiscard]] std::optional<SE3> predictAt(std::int64_t utc_ns) const noexcept;
  // Up to here poses are final; and where the kept history begins. 0 before initialised().
  [[nodiscard]] std::int64_t newestUtcNs() const noexcept {
    return nodes_.empty() ? 0 : nodes_.back().utc_ns;
  }
  [[nodiscard]] std::int64_t oldestUtcNs() const noexcept {
    return nodes_.empty() ? 0 : nodes_.front().utc_ns;
  }
  // Altitude of the DVL above the bottom [m] at the newest valid ensemble not older than max_dvl_gap.
  [[nodiscard]] std::optional<double> altitude() const noexcept;
  [[nodiscard]] Eigen::Vector3d velocityBody() const noexcept;  // over ground [m/s]

  // Sensors behind the track up to a time. Seconds and leaps are counted from the beginning of the track.
  struct Quality {
    double unlocked_s = 0;       // of the track without bottom track, after a gap of max_dvl_gap [s]
    double untilted_s = 0;       // while attitude was held [s]
    bool attitude_held = false;  // attitude is silent then
    bool depth_held = false;     // depth is silent then
    // Depth of the body by pressure less that of the track, which swell moves less; and the standard
    // deviation that swell is seen to give the former, 0 in a calm sea [m].
    double pressure_off = 0, pressure_sigma = 0;
    std::uint64_t heading_leaps = 0;  // of the compass
    // Turn about odom's down axis by the gyro alone, whole turns counted [rad]; while it was silent, which
    // adds nothing [s]; and whether there is a gyro at all.
    double gyro_turn = 0, ungyro_s = 0;
    bool has_gyro = false;
    // Heading by the compass less that turn, since the gyro was last silent, 0 at first [rad]; that, summed
    // over the time [rad s]; and the time [s].
    double compass_off = 0, compass_off_sum = 0, compass_off_s = 0;
    // Standard deviation of horizontal velocities' scale by a speed of sound that only the DVL gives [1].
    double sound_share = 0;

    static void exchange(auto& archive, auto& self) {
      archive(self.unlocked_s, self.untilted_s, self.attitude_held, self.depth_held, self.pressure_off,
              self.pressure_sigma, self.heading_leaps, self.gyro_turn, self.ungyro_s, self.has_gyro,
              self.compass_off, self.compass_off_sum, self.compass_off_s, self.sound_share);
    }
    // What the compass reads beyond its mean over that time, as the gyro has it [rad].
    [[nodiscard]] double compassBeyondMean() const {
      return compass_off_s > 0 ? compass_off - compass_off_sum / compass_off_s : 0;
    }
  };
  // At a time within the kept history, as poseAt(); beyond its ends: that of the end.
  [[nodiscard]] Quality qualityAt(std::int64_t utc_ns) const noexcept;

  struct Counters {
    std::uint64_t dvl_used = 0;            // velocities that entered the track
    std::uint64_t dvl_without_bottom = 0;  // ensembles without a bottom-track velocity
    std::uint64_t dvl_rejected = 0;        // faster than max_speed, no number, or an instrument that is stuck
    std::uint64_t out_of_order = 0;        // any sensor: not later than its last; or too late for the track
    std::uint64_t time_leaps = 0;  // any sensor: stamp far ahead of its last and alone, or no time at all
    std::uint64_t attitude_rejected = 0, depth_rejected = 0, water_rejected = 0,
                  gyro_rejected = 0;       // impossible values
    std::uint64_t gyro_used = 0;           // rates of turn
    std::uint64_t sound_speed_absent = 0;  // ensembles without a possible one: taken as corrected
    std::uint64_t dvl_before_start = 0;    // velocities before the first attitude and depth
    std::uint64_t dvl_queue_full = 0;      // velocities lost because too many waited for attitude and depth
    std::uint64_t coasted = 0;             // times that bottom track stayed away longer than max_dvl_gap
    std::uint64_t attitude_held = 0, depth_held = 0;  // velocities used without waiting for a silent sensor
    std::uint64_t heading_leaps = 0;                  // of the compass, taken out
  };
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }

  // Bit by bit, into one of the same configuration.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  static void exchange(auto& archive, auto& self);
  // The track at one moment; position of the DVL, depth of the body.
  struct Node {
    std::int64_t utc_ns = 0;
    Eigen::Quaterniond R_odom_body = Eigen::Quaterniond::Identity();
    Eigen::Vector3d p_dvl = Eigen::Vector3d::Zero();  // in odom [m]; z drifts: for differences only
    Eigen::Vector3d v_dvl = Eigen::Vector3d::Zero();  // of the DVL over ground, in odom [m/s]
    double depth = 0;                                 // of the body [m]
    double heading_rate = 0;                          // by the gyro [rad/s]
    Quality quality;                                  // but for the leaps of heading

    static void exchange(auto& archive, auto& self) {
      archive.instants(self.utc_ns);
      archive(self.R_odom_body, self.p_dvl, self.v_dvl, self.depth, self.heading_rate, self.quality);
    }
  };
  struct Velocity {
    std::int64_t utc_ns = 0;
    Eigen::Vector3d value = Eigen::Vector3d::Zero();  // of the DVL over ground, in body axes [m/s]

    static void exchange(auto& archive, auto& self) {
      archive.instants(self.utc_ns);
      archive(self.value);
    }
  };

  // What the DVL last measured, since when without any change.
  struct Reading {
    std::int64_t since_ns = 0;
    std::uint32_t repeats = 0;
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
    std::array<double, 4> range{};  // 0: none

    static void exchange(auto& archive, auto& self) {
      archive.instants(self.since_ns);
      archive(self.repeats, self.velocity, self.range);
    }
  };

  static constexpr std::size_t kNodes = 1024;   // 20 s at the closest spacing of nodes
  static constexpr std::size_t kWaiting = 128;  // ensembles: 12 s at 10 Hz, beyond the silence allowed
  static constexpr std::size_t kLeaps = 64;     // of heading, whose times are kept

  [[nodiscard]] bool stuck(const DvlSample& sample) noexcept;
  [[nodiscard]] bool checkTime(TimeGate& gate, std::int64_t utc_ns) noexcept;
  void advance() noexcept;
  [[nodiscard]] bool reached(const TimeGate& gate, std::int64_t utc_ns) const noexcept;
  void use(const Velocity& velocity) noexcept;
  void coast() noexcept;
  void trackTo(std::int64_t utc_ns, const auto& velocity_at) noexcept;
  [[nodiscard]] Eigen::Vector3d rateOfTurn(std::int64_t utc_ns) const noexcept;
  [[nodiscard]] Eigen::Quaterniond turnedOn(std::int64_t utc_ns) const noexcept;
  void appendNode(std::int64_t utc_ns, const Eigen::Vector3d& velocity_body) noexcept;
  void rate(Node& node, const Node& before) const noexcept;
  void followCompass(Node& node, const Node& before) const noexcept;
  [[nodiscard]] double withoutLeap(double heading, std::int64_t utc_ns) noexcept;
  void placeDepth(Node& node, const Node* before) noexcept;
  [[nodiscard]] double soundSpeedFactor(double assumed) noexcept;
  [[nodiscard]] double soundShare() const noexcept;

  DeadReckoningConfig config_;
  Eigen::Quaterniond R_body_compass_inverse_;
  TimeGate dvl_times_, attitude_times_, depth_times_, gyro_times_;
  Reading reading_;
  std::int64_t now_ = 0;                             // newest time of any sensor
  RotationHistory attitudes_;                        // R_odom_body
  double last_heading_ = 0, removed_heading_ = 0;    // of the compass, in odom; sum of leaps [rad]
  rt::FixedQueue<std::int64_t, kLeaps> leap_times_;  // of headings [ns]
  NumberHistory depths_;                             // of the pressure sensor [m]
  RateHistory rates_;
  rt::FixedQueue<Velocity, kWaiting> waiting_;
  rt::FixedQueue<Node, kNodes> nodes_;
  Velocity last_velocity_;                                    // newest that entered the track
  Eigen::Vector3d coast_velocity_ = Eigen::Vector3d::Zero();  // of the body when bottom track went [m/s]
  bool coasting_ = false;
  DepthFilter depth_filter_;
  std::optional<double> sound_speed_;  // true, newest known [m/s]
  bool own_sound_speed_ = false;       // an ensemble had another one than the nominal
  std::optional<TimedNumber> altitude_;
  Counters counters_;
};

}  // namespace fathom::nav
