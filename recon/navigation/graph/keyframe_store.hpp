#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "realtime/kernel/rings/numbered_pool.hpp"
#include "recon/navigation/gating/heading_gate.hpp"
#include "recon/navigation/graph/navigation_config.hpp"
#include "recon/navigation/sensors/dvl_calibration.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"

namespace fathom::slam {

// What a navigation graph took in and rejected.
struct NavigationCounters {
  std::uint64_t keyframes = 0, keyframes_refused = 0, keyframes_retired = 0, references = 0,
                references_retired = 0;
  std::uint64_t odometry_links = 0, closures = 0, links_contradicting = 0, links_off = 0, links_refused = 0;
  std::uint64_t fixes = 0, fixes_gated = 0, fixes_off = 0, fixes_refused = 0;
  std::uint64_t steps_contradicted = 0, steps_left_out = 0, compass_jumps = 0, attitude_absent = 0,
                depth_absent = 0, dvl_absent = 0;
  // Keyframes whose compass reading, and steps whose visual odometry, is rejected now.
  std::uint64_t compass_rejected = 0, visual_rejected = 0;
  bool dvl_rejected = false;  // the DVL, after `reject_after` contradictions in a row
};

// A keyframe of the graph, and its factors: indices of the solver's measurements, -1 where there is none.
struct Keyframe {
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;
  SE3 known;                            // pose that takeChange() last gave
  int node = 0;                         // in the solver
  int step = -1;                        // dead reckoning from the keyframe before
  int attitude = -1;                    // attitude against its reference
  int drift = -1;                       // drift to the reference that begins here
  int link = -1;                        // visual odometry from the keyframe before
  VisualTurn visual_turn;               // of that
  double gyro_turn = 0, ungyro_s = -1;  // of the step (KeyframeInput)
  double range = 2;                     // to the seafloor [m]
  bool compass_jumped = false;          // on the step
  bool mixed_reference = false;         // its reference of attitude began before the compass's present one
  StepQuality quality;                  // of the step
  double step_weight = 1;               // of the step's information, below 1 where a wrong compass turned it
  HeadingGate::Verdict heading;
  bool dvl_rejected = false, link_rejected = false;  // by their velocities
  std::array<bool, 3> counted{};                     // as rejected: compass, visual odometry, DVL
  bool waiting = false;                              // among the changes

  [[nodiscard]] bool visualRejected() const { return link >= 0 && (!heading.visual || link_rejected); }
  [[nodiscard]] bool visualAccepted() const { return link >= 0 && !visualRejected(); }

  static void exchange(auto& archive, auto& k) {
    archive(k.utc_ns, k.T_odom_cam, k.known, k.node, k.step, k.attitude, k.drift, k.link, k.gyro_turn,
            k.ungyro_s, k.compass_jumped, k.mixed_reference, k.heading.compass, k.heading.visual,
            k.heading.restarts, k.dvl_rejected, k.step_weight, k.link_rejected, k.counted, k.waiting, k.range,
            k.visual_turn);
    archive(k.quality.seconds, k.quality.seconds_unlocked, k.quality.seconds_untilted,
            k.quality.calibration_share, k.quality.turn, k.quality.pressure_sigma);
  }
};

// The keyframes of a navigation graph with their poses and factors in the solver, and which of them have
// moved since their reader last took their poses. Fixed memory.
class KeyframeStore {
 public:
  static constexpr int kKeyframesPerReference = 4, kSpareReferences = 200;
  // References of attitude and depth that the solver has room for.
  [[nodiscard]] static int maxReferences(int keyframes) {
    return keyframes / kKeyframesPerReference + kSpareReferences;
  }
  // Weight of a rejected factor that must still hold two parts together, or measures tilt besides heading:
  // its standard deviations are inflated a hundredfold, to half a metre and ten degrees.
  static constexpr double kInflated = 1e-4;

  explicit KeyframeStore(const NavigationConfig& config);

  // Number of the next keyframe; those that have not retired, rising; the newest.
  [[nodiscard]] int next() const { return keyframes_.next(); }
  [[nodiscard]] std::span<const int> living() const { return keyframes_.numbers(); }
  [[nodiscard]] bool has(int keyframe) const { return keyframes_.has(keyframe); }
  [[nodiscard]] Keyframe& operator[](int keyframe) { return keyframes_[at(keyframe)]; }
  [[nodiscard]] const Keyframe& operator[](int keyframe) const { return keyframes_[at(keyframe)]; }
  [[nodiscard]] const Keyframe& back() const { return keyframes_.back(); }
  [[nodiscard]] const SE3& pose(int keyframe) const { return solver_.pose((*this)[keyframe].node); }
  [[nodiscard]] int ofNode(int node) const { return keyframe_of_node_[at(node)]; }  // -1: a reference
  [[nodiscard]] bool isNode(int node) const {
    return node >= 0 && node < solver_.size() && !solver_.isRetired(node);
  }
  [[nodiscard]] bool isMeasurement(int k) const {
    return k >= 0 && k < solver_.measurements() && solver_.measurement(k).in_use;
  }
  [[nodiscard]] bool isFull() const { return keyframes_.full(); }
  // Fewer than `spare` places are free.
  [[nodiscard]] bool isShort(std::size_t spare) const;
  // Of two neighbours in time that have not retired, the nearer one.
  [[nodiscard]] int nearestInTime(int keyframe, std::int64_t utc_ns) const;

  int add(const Keyframe& keyframe) { return keyframes_.add(keyframe); }
  void erase(int keyframe);
  // A pose of the solver, for a reference or for the next keyframe; -1 when it is refused.
  [[nodiscard]] int addNode(const SE3& pose);
  [[nodiscard]] int addKeyframeNode(const SE3& pose);
  [[nodiscard]] int addFactor(const RelativePose& factor);  // -1 when refused
  // Squared Mahalanobis distance of a factor's error; `covariance` of its right perturbation.
  [[nodiscard]] double distance2(const RelativePose& factor, const Matrix6d& covariance) const;
  // A node that must not retire: 1 unless it is a keyframe's.
  void setMustStay(int node, bool must) { must_stay_[at(node)] = must ? 1 : 0; }
  [[nodiscard]] std::span<const std::uint8_t> mustStay() const { return must_stay_; }
  // Sets the weights of a step's factors by its verdicts: 1 where accepted; of step and visual link one
  // remains in force, inflated at least.
  void weigh(Keyframe& keyframe);

  // Of NavigationGraph.
  void noteChanges();
  std::optional<int> takeChange();
  void takeAllChanges();
  [[nodiscard]] std::size_t changesWaiting() const { return changed_.size(); }

  [[nodiscard]] const NavigationConfig& config() const { return config_; }
  [[nodiscard]] IncrementalSolver& solver() { return solver_; }
  [[nodiscard]] const IncrementalSolver& solver() const { return solver_; }
  [[nodiscard]] NavigationCounters& counters() { return counters_; }
  [[nodiscard]] const NavigationCounters& counters() const { return counters_; }
  [[nodiscard]] std::size_t memoryBytes() const;

  // For saved state; then rebuildIndices(): false if an index is invalid or used twice.
  static void exchangeChanges(auto& archive, auto& self) {
    archive.bounded(self.changed_, self.changed_.capacity());
  }
  static void exchangeKeyframes(auto& archive, auto& self) {
    auto& c = self.counters_;
    archive(c.keyframes, c.keyframes_refused, c.keyframes_retired, c.references, c.references_retired,
            c.odometry_links, c.closures, c.links_contradicting, c.links_off, c.links_refused, c.fixes,
            c.fixes_gated, c.fixes_off, c.fixes_refused, c.steps_contradicted, c.steps_left_out,
            c.compass_jumps, c.attitude_absent, c.depth_absent, c.dvl_absent, c.compass_rejected,
            c.visual_rejected, c.dvl_rejected);
    archive(self.keyframes_);
  }
  [[nodiscard]] bool rebuildIndices();

 private:
  void noteTaken(int keyframe) {
    (*this)[keyframe].waiting = false;
    (*this)[keyframe].known = pose(keyframe);
  }

  NavigationConfig config_;
  IncrementalSolver solver_;
  rt::NumberedPool<Keyframe> keyframes_;
  std::vector<int> keyframe_of_node_;
  std::vector<std::uint8_t> must_stay_;
  std::vector<int> changed_;  // keyframes
  NavigationCounters counters_;
};

// Error of a factor as a right perturbation (rho, phi).
[[nodiscard]] Vector6d perturbationOf(const RelativePose& factor, const SE3& T_from, const SE3& T_to);

}  // namespace fathom::slam
