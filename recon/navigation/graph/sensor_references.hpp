#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "recon/navigation/graph/keyframe_store.hpp"

namespace fathom::slam {

// What a keyframe enters with.
struct KeyframeInput {
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;              // dead reckoning
  double unlocked_s = 0;       // since the last keyframe without bottom track [s]
  double untilted_s = 0;       // without attitude [s]
  bool attitude_held = false;  // at its time: attitude is not measured
  bool depth_held = false;     // depth is not measured
  // Depth by pressure less that of T_odom_cam, and the standard deviation
  // that swell adds to the noise of the former [m].
  double pressure_off = 0, pressure_sigma = 0;
  bool compass_jumped = false;  // since the last keyframe (nav::DeadReckoning removed the jump)
  // Turn of the body about nav's down axis since the last keyframe as the
  // gyro has it, whole turns counted [rad], and for how long of that the gyro
  // was silent, which added nothing to it [s]; negative: no gyro at all.
  double gyro_turn = 0, ungyro_s = -1;
  CompassOff compass_off = {};
  double range = 2;  // from the camera to the seafloor [m]
  // Standard deviation of the DVL's scale by a speed of sound that is not measured (nav::DeadReckoning) [1].
  double sound_share = 0;

  // What dead reckoning says of its sensors (nav::DeadReckoning::Quality) at the last keyframe and at this
  // one. The rest is the caller's: time, pose, range, and bottom track, which images may contradict.
  template <typename Quality>
  [[nodiscard]] static KeyframeInput between(const Quality& before, const Quality& now) {
    KeyframeInput input;
    input.untilted_s = now.untilted_s - before.untilted_s;
    input.attitude_held = now.attitude_held;
    input.depth_held = now.depth_held;
    input.pressure_off = now.pressure_off;
    input.pressure_sigma = now.pressure_sigma;
    input.compass_jumped = now.heading_leaps > before.heading_leaps;
    input.sound_share = now.sound_share;
    if (!now.has_gyro) return input;
    input.gyro_turn = now.gyro_turn - before.gyro_turn;
    input.ungyro_s = now.ungyro_s - before.ungyro_s;
    input.compass_off = {now.compassBeyondMean(), now.compass_off_s};
    return input;
  }
};

// References of attitude (compass deviation, bias of roll and pitch) and of depth (tide) of a navigation
// graph: poses that vary slowly, against which keyframes' readings are factors (sensor_factors.hpp). One of
// attitude serves NavigationConfig::reference_s and reference_turn, a younger one of the present heading
// again, none across a jump of the compass. Fixed memory: their number is limited by a credit that grows with
// the keyframes, so that endless turning leaves room for these.
class SensorReferences {
 public:
  explicit SensorReferences(KeyframeStore& keyframes);

  // Adds a keyframe's factors of attitude and depth, with new references where the present ones have served.
  void addKeyframe(const KeyframeInput& input, Keyframe& keyframe);

  // The compass has another reference from a time on; and whether one of attitude still has to begin for it.
  void noteJump(std::int64_t utc_ns) { jumped_ns_ = std::max(jumped_ns_, utc_ns); }
  void setJumpWaits(bool waits) { jump_waits_ = waits; }

  // Nodes of attitude's references that began at a time or later.
  void appendAttitudeNodes(std::int64_t since_ns, std::vector<int>& nodes) const;
  // As NavigationGraph gives them.
  [[nodiscard]] double deviation() const {
    return attitude_.node < 0 ? 0 : -keyframes_.solver().pose(attitude_.node).euler().z();
  }
  [[nodiscard]] double seaHeight() const {
    return depth_.node < 0 ? 0 : -keyframes_.solver().pose(depth_.node).translation().z();
  }

  // Fewer than `spare` places are free.
  [[nodiscard]] bool isShort(std::size_t spare) const;
  // Position of the reference that fewest measurements name, as no keyframe that it served is left;
  // std::nullopt: all are needed. Looks at a bounded number, from where the last call ended.
  [[nodiscard]] std::optional<std::size_t> leastNeeded(std::size_t most_named);
  [[nodiscard]] int node(std::size_t position) const { return references_[position].node; }
  void erase(std::size_t position);

  // For saved state; then isConsistent(): false if an index is invalid or used twice.
  static void exchangeJump(auto& archive, auto& self) { archive(self.jump_waits_); }
  static void exchange(auto& archive, auto& self) {
    archive(self.attitude_, self.depth_, self.tide_);
    archive.bounded(self.references_, self.references_.capacity());
    archive(self.next_, self.credit_, self.jumped_ns_);
  }
  [[nodiscard]] bool isConsistent() const;
  [[nodiscard]] bool has(int node) const;
  [[nodiscard]] std::size_t memoryBytes() const { return references_.capacity() * sizeof(Reference); }

 private:
  struct Reference {
    int node = -1;
    std::int64_t utc_ns = 0;
    double heading = 0;  // of the vehicle when it began [rad]
    bool of_depth = false;

    static void exchange(auto& archive, auto& self) {
      archive(self.node, self.utc_ns, self.heading, self.of_depth);
    }
  };
  [[nodiscard]] int newReference(const SE3& start);
  [[nodiscard]] bool reuseReference(std::int64_t utc_ns, double heading);
  void beginAttitude(const KeyframeInput& input, Keyframe& keyframe, double heading, double age, double turn);
  void addAttitude(const KeyframeInput& input, Keyframe& keyframe);
  void addDepth(const KeyframeInput& input, int node);
  void beginDepth(std::int64_t utc_ns);

  KeyframeStore& keyframes_;
  const NavigationConfig& config_;
  std::vector<Reference> references_;  // oldest first
  std::size_t next_ = 0;               // to be looked at for retirement
  int credit_;                         // in quarters of a reference
  std::int64_t jumped_ns_ = 0;         // references before this do not serve again
  Reference attitude_, depth_, tide_;  // present ones
  bool jump_waits_ = false;
};

}  // namespace fathom::slam
