#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <type_traits>
#include <variant>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/kernel/rings/fixed_queue.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/navigation/dead_reckoning/camera_clock.hpp"
#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"
#include "recon/navigation/dead_reckoning/sensor_history.hpp"

namespace fathom::onboard {

// Pairs each exposure of one camera with the nearest of the other within a tolerance. The two streams may
// arrive in any order relative to each other; each is ordered in time. Fixed memory.
//
// The cameras' clocks drift apart (+-50 ppm each give 0.36 s per hour), so the tolerance is relative to a
// skew, right less left, that tracks the pairs found: each pair moves it by an eighth of its residual, at
// most by the possible drift of two clocks since the previous pair. A camera that exposes late leaves the
// skew unchanged. After a time without pairs (a descent since `start_ns`, or cameras switched off) the
// tolerance is wider by the possible drift in that time, and the first pair sets the skew; but not where that
// leaves two candidate frames (at 2 Hz after 20 minutes).
class StereoPairing {
 public:
  struct Frame {
    std::int64_t utc_ns = 0;
    std::uint32_t frame_id = 0;

    static void exchange(auto& archive, auto& self) { archive(self.utc_ns, self.frame_id); }
  };
  struct Pair {
    Frame left, right;

    static void exchange(auto& archive, auto& self) { archive(self.left, self.right); }
  };

  // `tolerance_ns`: largest difference of exposure times of a pair; below half the time between frames.
  // `start_ns`: when the clocks' offsets were known; 0: at the first frames.
  explicit StereoPairing(std::int64_t tolerance_ns, std::int64_t start_ns = 0) noexcept
      : tolerance_ns_(tolerance_ns), newest_pair_ns_(start_ns) {}

  // The pair that this frame completes, if it does.
  [[nodiscard]] std::optional<Pair> add(CameraSide side, const Frame& frame) noexcept;

  // Frames given up without a partner; and frames refused because their time did not grow or leapt far ahead.
  [[nodiscard]] std::uint64_t unpaired(CameraSide side) const noexcept { return of(side).unpaired; }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_; }
  [[nodiscard]] std::int64_t skewNs() const noexcept { return skew_ns_; }  // right less left, followed

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) {
    archive(self.skew_ns_, self.newest_pair_ns_, self.period_ns_, self.streams_, self.refused_);
  }

 private:
  // Enough for one camera 16 frames behind the other; then the oldest is given up.
  static constexpr std::size_t kWaiting = 16;
  struct Stream {
    nav::TimeGate times;
    rt::FixedQueue<Frame, kWaiting> waiting;
    std::uint64_t unpaired = 0;

    static void exchange(auto& archive, auto& self) { archive(self.times, self.waiting, self.unpaired); }
  };
  // That two clocks may have drifted apart since the newest pair.
  [[nodiscard]] std::int64_t driftAt(std::int64_t utc_ns) const noexcept;
  void followSkew(const Pair& pair) noexcept;
  [[nodiscard]] const Stream& of(CameraSide side) const noexcept {
    return streams_[static_cast<std::size_t>(side)];
  }

  static constexpr std::int64_t kSkewFollow = 8;  // a pair moves the skew by this part of its residual
  static constexpr std::int64_t kDriftShare =
      5000;  // of a time, that two clocks of 100 ppm drift apart in it
  std::int64_t tolerance_ns_;
  std::int64_t skew_ns_ = 0;
  std::int64_t newest_pair_ns_;  // left exposure; before there is one: start_ns
  std::int64_t period_ns_ = 0;   // between frames of a camera, the shortest; 0: not known
  std::array<Stream, 2> streams_;
  std::uint64_t refused_ = 0;
};

struct NavCoreConfig {
  nav::DeadReckoningConfig odometry;
  std::int64_t start_utc_ns = 0;     // when the time offsets were known; 0: at the first exposures
  double pairing_tolerance = 0.020;  // largest difference of the exposures of a stereo pair [s]
  bool predict_pairs = true;         // false: a pair waits for its final pose
  // Added to the time stamps of a sensor to get UTC [s]; zero where the stamps are corrected already.
  struct TimeOffsets {
    double left_camera = 0, right_camera = 0, dvl = 0, compass = 0, depth = 0;
  } time_offsets;
};

// A stereo pair and where it was taken: what starts MapCore on it.
struct StereoTrigger {
  // Kind of the pose. A pair is given at once with a predicted pose, and again when the odometry covers its
  // time; a pair without a prediction is given once.
  enum class Pose : std::uint8_t {
    kPredicted,  // another one follows
    kFinal,      // the first, and final
    kCorrected   // final, of a pair that came as kPredicted
  } pose = Pose::kFinal;
  std::uint32_t pair_index = 0;  // counts pairs from 0; a gap is a pair that was dropped
  std::int64_t utc_ns = 0;       // of the left exposure, offset corrected
  std::uint32_t left_frame_id = 0, right_frame_id = 0;
  SE3 T_odom_body;      // at utc_ns
  double altitude = 0;  // of the DVL above the bottom [m], newest valid ensemble
  bool altitude_valid = false;
  nav::DeadReckoning::Quality quality;  // of the track up to then

  static void exchange(auto& archive, auto& self) {
    archive.enumeration(self.pose, Pose::kCorrected);
    archive(self.pair_index, self.utc_ns, self.left_frame_id, self.right_frame_id, self.T_odom_body,
            self.altitude, self.altitude_valid, self.quality);
  }
};

// State of navigation at a health tick. Ages are of the newest sample of a sensor; -1: none so far.
struct NavHealth {
  struct Counter {
    std::string_view name;
    std::uint64_t value = 0;
  };
  static constexpr std::size_t kCounters = 26;

  std::int64_t utc_ns = 0;  // of the tick
  double dvl_age = -1, attitude_age = -1, depth_age = -1, water_age = -1, left_age = -1,
         right_age = -1;                    // [s]
  bool initialised = false;                 // odometry runs
  double odometry_age = -1;                 // of the newest final pose [s]
  std::optional<double> altitude;           // [m]
  double depth = 0;                         // of the body at the newest final pose [m]
  double speed = 0;                         // over ground [m/s]
  std::size_t waiting_pairs = 0;            // that the odometry has not reached
  std::array<Counter, kCounters> counters;  // everything counted so far, under its name
};

// A pair is given at once with its predicted pose, then waits until every navigation sensor has reached its
// time and is given again. When too many wait, the oldest is dropped and counted; so is the oldest trigger
// when nobody polls. Predicted and final triggers each keep the order of the pairs.
class NavCore {
 public:
  // The config's numbers are finite and its tolerance positive (the mission's reader sees to it).
  explicit NavCore(const NavCoreConfig& config);

  void add(const DvlSample& sample) noexcept;
  void add(const AttitudeSample& sample) noexcept;
  void add(const GyroSample& sample) noexcept;
  void add(const DepthSample& sample) noexcept;
  void add(const WaterSample& sample) noexcept;  // sound speed only
  // `frame_id`: a handle that the caller resolves to the pixels.
  void addFrame(std::int64_t stamp_utc_ns, CameraSide side, std::uint32_t frame_id) noexcept;
  void tick(std::int64_t utc_ns) noexcept;  // health is asked for

  // The oldest trigger not yet taken.
  [[nodiscard]] std::optional<StereoTrigger> pollTrigger() noexcept;

  // As of the newest health tick; utc_ns is 0 before the first.
  [[nodiscard]] const NavHealth& health() const noexcept { return health_; }
  [[nodiscard]] const nav::DeadReckoning& odometry() const noexcept { return odometry_; }

  // Bit by bit, into one of the same configuration, which then continues identically.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  static constexpr std::size_t kWaitingPairs = 32;  // 16 s at 2 Hz: longer than any wait that ends well
  static constexpr std::size_t kTriggers = 64;
  struct WaitingPair {
    std::uint32_t index = 0;
    StereoPairing::Pair frames;
    bool predicted = false;  // it was given where it probably is

    static void exchange(auto& archive, auto& self) { archive(self.index, self.frames, self.predicted); }
  };
  struct LastSeen {
    std::int64_t utc_ns = 0;
    bool any = false;

    static void exchange(auto& archive, auto& self) { archive(self.utc_ns, self.any); }
  };
  struct Counters {
    std::uint64_t inputs = 0, pairs = 0, pairs_predicted = 0, pairs_uncovered = 0, triggers = 0,
                  triggers_dropped = 0;
  };

  template <class Sample>
  void take(Sample sample, std::int64_t offset_ns, LastSeen* seen) noexcept;
  void dispatch() noexcept;
  void predict() noexcept;
  void give(const WaitingPair& pair, StereoTrigger::Pose what, const SE3& T_odom_body) noexcept;
  void takeHealth(std::int64_t utc_ns) noexcept;

  bool predicts_;
  nav::DeadReckoning odometry_;
  StereoPairing pairing_;
  std::int64_t left_offset_ns_, right_offset_ns_, dvl_offset_ns_, compass_offset_ns_, depth_offset_ns_;
  rt::FixedQueue<WaitingPair, kWaitingPairs> waiting_;
  rt::FixedQueue<StereoTrigger, kTriggers> triggers_;
  LastSeen dvl_, attitude_, depth_, water_, left_, right_;
  Counters counters_;
  NavHealth health_;
};

// NavCore with its input stage: numbers the exposures and converts their stamps to vehicle time. The same
// calls give the same state, bit for bit: the hard tier has one for poses and health at 100 Hz, the soft tier
// another that follows the same inputs, so that it finds the pose of any moment without asking the hard tier.
// Allocates nothing after construction.
class NavFeed {
 public:
  explicit NavFeed(const NavCoreConfig& config) : core_(config) {}

  template <class Sample>
  void add(const Sample& sample) noexcept {
    core_.add(sample);
  }
  // Whatever navigation has a use for; the rest is passed over.
  void add(const SensorSample& sample, std::int64_t arrival_utc_ns) noexcept {
    std::visit(
        [&](const auto& s) noexcept {
          using Sample = std::decay_t<decltype(s)>;
          if constexpr (std::is_same_v<Sample, ImageEvent>)
            (void)addExposure(s.utc_ns, s.side, arrival_utc_ns);
          else if constexpr (requires { core_.add(s); })
            core_.add(s);
        },
        sample);
  }
  // An exposure stamped `stamp_utc_ns` that arrived then; returns its number, from 0.
  std::uint32_t addExposure(std::int64_t stamp_utc_ns, CameraSide side,
                            std::int64_t arrival_utc_ns) noexcept {
    nav::CameraClock& clock = side == CameraSide::kLeft ? left_clock_ : right_clock_;
    core_.addFrame(clock.utcNs(stamp_utc_ns, arrival_utc_ns), side, exposures_);
    return exposures_++;
  }
  void tick(std::int64_t now_ns) noexcept { core_.tick(now_ns); }

  [[nodiscard]] NavCore& core() noexcept { return core_; }
  [[nodiscard]] const NavCore& core() const noexcept { return core_; }
  [[nodiscard]] const nav::CameraClock& leftClock() const noexcept { return left_clock_; }
  [[nodiscard]] const nav::CameraClock& rightClock() const noexcept { return right_clock_; }
  [[nodiscard]] std::uint32_t exposures() const noexcept { return exposures_; }

  // Bit by bit, into one of the same configuration.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  NavCore core_;
  nav::CameraClock left_clock_, right_clock_;
  std::uint32_t exposures_ = 0;
};

}  // namespace fathom::onboard
