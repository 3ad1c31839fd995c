#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "realtime/kernel/state_archive_fwd.hpp"
#include "recon/slam/dvl_calibration.hpp"
#include "recon/slam/incremental_solver.hpp"
#include "recon/slam/sensor_factors.hpp"

namespace fathom::slam {

struct NavigationConfig {
  int max_keyframes = 12000;
  int max_links = 24000;  // visual odometry and closures
  int max_fixes = 4000;
  double reference_s = 20;       // a reference of attitude serves so long [s]
  double reference_turn = 0.17;  // and over so much turning [rad]
  double jump_heading = 0.3;  // standard deviation of heading's reference after a jump of the compass [rad]
  double gate = 22.46;        // squared Mahalanobis distance of a link: chi-square, 6 degrees, 99.9 %
  double fix_gate = 13.82;    // of a fix: 2 degrees, 99.9 %
  int lying_after = 5;        // contradictions in a row by which a sensor is taken to lie
  int reweighted = 6;         // links and fixes a step whose robust weight is looked at again
  double change_m = 0.01;     // smallest move of a keyframe that is reported [m]
  double change_rad = 0.005;  // and turn [rad]
  double lever = 0;           // from the DVL to the camera [m]
  SensorNoise noise;
  IncrementalConfig solver;  // its sizes are set from the above

  void validate() const;  // throws std::invalid_argument
};

// What a keyframe enters with.
struct KeyframeInput {
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;               // dead reckoning
  double unlocked_s = 0;        // since the last keyframe without bottom track [s]
  double untilted_s = 0;        // without attitude [s]
  bool attitude_held = false;   // at its time: attitude is not measured
  bool depth_held = false;      // depth is not measured
  bool compass_jumped = false;  // since the last keyframe (nav::DeadReckoning took the leap out)
};

// kAgreed: a closure that others agree with around a cycle, whatever the graph says.
enum class LinkKind : std::uint8_t { kOdometry, kClosure, kAgreed };
enum class Taken : std::uint8_t { kYes, kContradicts, kFull, kBad };

// The vehicle's navigation as a graph of poses in information form: one pose for each stereo keyframe, and
// references of attitude (compass deviation, bias of roll and pitch) and depth (tide), which vary slowly;
// what dead reckoning, attitude, depth, fixes, visual odometry and loop closures say are its factors
// (sensor_factors.hpp). View-based (Eustice et al. 2006; Mahon et al. 2008): the vehicle's present pose is
// the newest keyframe's and dead reckoning from there. DVL scale and misalignment: DvlCalibration.
//
// Every link and fix must agree with what is known, by the graph's own covariance, before it enters; after,
// its weight is Cauchy's, which switches off what the rest contradicts and on again. Fixed memory, bounded
// work a call; same calls, same result.
class NavigationGraph {
 public:
  explicit NavigationGraph(const NavigationConfig& config);

  // Where odom's origin is in nav as far as known when the first keyframe comes (nav - odom, horizontal), and
  // its standard deviation; a kilometre if never said.
  void setAnchor(const Eigen::Vector2d& shift, double sigma);

  // The keyframe's number, counting from 0; std::nullopt when there is no room.
  std::optional<int> addKeyframe(const KeyframeInput& input);

  struct Prediction {
    SE3 T_a_b;
    Matrix6d covariance;  // of its right perturbation (rho, phi)
  };
  // Keyframe b seen from a. Of keyframes that step() has taken in.
  [[nodiscard]] Prediction predict(int a, int b);

  // A relative pose T_a_b of two keyframes' cameras, with the covariance of its right perturbation. Visual
  // odometry (of consecutive keyframes) that contradicts dead reckoning wins: the step is left out and
  // counted, and a DVL that is contradicted again and again is not believed until it agrees again.
  Taken addLink(LinkKind kind, int a, int b, const SE3& T_a_b, const Matrix6d& covariance);

  // A position fix of an antenna at `antenna_in_odom`, whenever it arrives: it holds at keyframe `at`, the
  // nearest in time, and odometry knows the way between. `sigma`: of either component [m].
  Taken addFix(int at, const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& north_east,
               double sigma);

  // A bounded part of the work that is to do.
  StepReport step();

  [[nodiscard]] int keyframes() const { return static_cast<int>(frames_.size()); }
  [[nodiscard]] const SE3& pose(int keyframe) const {
    return solver_.pose(frames_[at(keyframe)].node);
  }  // T_nav_cam
  [[nodiscard]] const SE3& odometry(int keyframe) const { return frames_[at(keyframe)].T_odom_cam; }
  [[nodiscard]] std::int64_t utcNs(int keyframe) const { return frames_[at(keyframe)].utc_ns; }
  [[nodiscard]] Matrix6d covariance(int keyframe) { return solver_.covariance(frames_[at(keyframe)].node); }
  // From the newest keyframe: where odom is now. Identity without keyframes.
  [[nodiscard]] SE3 T_nav_odom() const;
  // Compass deviation at the newest keyframe [rad].
  [[nodiscard]] double deviation() const;

  // The keyframe that has moved most since its pose was last taken here; std::nullopt when none moved by more
  // than change_m or change_rad. Taking it marks it as known.
  std::optional<int> takeChange();
  // Marks all as known.
  void takeAllChanges();
  [[nodiscard]] std::size_t changesWaiting() const { return changed_.size(); }

  struct Counters {
    std::uint64_t keyframes = 0, keyframes_refused = 0, references = 0;
    std::uint64_t odometry_links = 0, closures = 0, links_contradicting = 0, links_off = 0, links_refused = 0;
    std::uint64_t fixes = 0, fixes_gated = 0, fixes_off = 0, fixes_refused = 0;
    std::uint64_t steps_contradicted = 0, steps_left_out = 0, compass_jumps = 0, attitude_absent = 0,
                  depth_absent = 0, dvl_absent = 0;
    bool dvl_lies = false;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

  // Poses and what the sensors alone say of them, as a batch solver takes it: all factors that are in force
  // but links and fixes. Pose 0 is nav's origin.
  [[nodiscard]] PoseGraph sensorGraph() const;
  [[nodiscard]] int node(int keyframe) const { return frames_[at(keyframe)].node; }
  [[nodiscard]] const DvlCalibration& dvl() const { return dvl_; }
  [[nodiscard]] const IncrementalSolver& solver() const { return solver_; }
  [[nodiscard]] std::size_t memoryBytes() const;

  // Into a graph of the same configuration: every pose bit by bit, the solver's factor anew. A graph whose
  // load() failed is of no use.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  template <typename Archive, typename Self>
  static void exchangeFrame(Archive& archive, Self& frame);
  template <typename Archive, typename Self>
  static void exchangeRobust(Archive& archive, Self& robust);
  [[nodiscard]] bool isWhole() const;  // as it must be when it was loaded

  struct Frame {
    std::int64_t utc_ns = 0;
    SE3 T_odom_cam;
    SE3 known;             // pose that takeChange() last gave
    int node = 0;          // in the solver
    int step = -1;         // measurement of the step from the keyframe before
    int attitude = -1;     // and of attitude
    StepQuality quality;   // of that step
    bool waiting = false;  // in changed_

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      exchangeFrame(archive, self);
    }
  };
  // A factor with a robust weight.
  struct Robust {
    RelativePose factor;
    Matrix6d covariance = Matrix6d::Zero();  // of a link
    int measurement = 0;
    double free_chi2 = 0;  // up to there its weight is 1
    double weight = 1;
    bool fix = false, off = false;

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      exchangeRobust(archive, self);
    }
  };
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  [[nodiscard]] int addNode(const SE3& pose);
  [[nodiscard]] int addFactor(const RelativePose& factor);  // -1 when refused
  [[nodiscard]] int refer(const KeyframeInput& input, int node, double seconds);
  void compareStep(Frame& from, Frame& to, const SE3& T_a_b, const Matrix6d& covariance);
  void referDepth(const KeyframeInput& input, int node);
  void reweight(bool settled);
  [[nodiscard]] bool fits(const Robust& r);
  void noteChanges();
  [[nodiscard]] double distance2(const RelativePose& factor, const Matrix6d& covariance) const;

  NavigationConfig config_;
  IncrementalSolver solver_;
  DvlCalibration dvl_;
  std::vector<Frame> frames_;
  std::vector<int> frame_of_node_;  // -1: a reference
  std::vector<Robust> robust_;
  std::vector<int> changed_;  // keyframes
  std::size_t next_robust_ = 0, newest_robust_ = 0;
  Eigen::Vector2d shift_ = Eigen::Vector2d::Zero();
  double shift_sigma_;
  struct Reference {
    int node = -1;
    std::int64_t utc_ns = 0;
    double heading = 0;
  };
  Reference attitude_, depth_;
  bool jump_waits_ = false;
  int contradictions_ = 0, agreements_ = 0, fixes_alike_ = 0, closures_refused_ = 0;
  Eigen::Vector2d gated_innovation_ = Eigen::Vector2d::Zero();  // of the last fix outside the gate [m]
  Counters counters_;
};

}  // namespace fathom::slam
