#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "recon/navigation/gating/fix_gate.hpp"
#include "recon/navigation/gating/robust_factors.hpp"
#include "recon/navigation/graph/sensor_references.hpp"

namespace fathom::slam {

// A keyframe that is gone. What hung on it by odometry at T_odom hangs on `onto` at T_onto * T_odom: its pose
// is the same, T_onto = odometry(onto) pose(onto)^-1 pose(keyframe) odometry(keyframe)^-1.
struct RetiredKeyframe {
  int keyframe = 0, onto = 0;
  SE3 T_onto;
};

// Makes room for keyframes to come: the keyframe that is missed least retires into what its measurements say
// about its neighbours (retirement.hpp), and references that few measurements name.
class KeyframeRetirement {
 public:
  KeyframeRetirement(KeyframeStore& keyframes, RobustFactors& robust, SensorReferences& references);

  void makeRoom();
  // By the last makeRoom(), in their order: one may be `onto` of an earlier one.
  [[nodiscard]] std::span<const RetiredKeyframe> retired() const { return retired_; }
  void clear() { retired_.clear(); }

 private:
  [[nodiscard]] bool retireKeyframe();
  void retireReference();
  [[nodiscard]] bool retireNode(int node);
  void forget(int measurement, int other_end);

  KeyframeStore& keyframes_;
  RobustFactors& robust_;
  SensorReferences& references_;
  std::vector<RetiredKeyframe> retired_;
};

// The vehicle's navigation as a graph of poses in information form: one pose for each stereo keyframe, and
// references of attitude (compass deviation, bias of roll and pitch) and depth (tide), which vary slowly;
// what dead reckoning, attitude, depth, fixes, visual odometry and loop closures say are its factors
// (sensor_factors.hpp). View-based (Eustice et al. 2006; Mahon et al. 2008): the vehicle's present pose is
// the newest keyframe's and dead reckoning from there.
//
// This class wires one class for each concern: KeyframeStore (keyframes, their factors, changes),
// SensorReferences, StepGate with HeadingGate and VelocityGate (compass, gyro, DVL, visual odometry),
// FixGate (GPS, USBL, covariances), LinkGate (closures), RobustFactors (weights of links and fixes),
// DvlCalibration and SharedTurns (errors that all steps and links share), KeyframeRetirement.
//
// Each factor that may be an outlier has a weight, set by one of these classes. Closures and fixes must agree
// with the graph's own covariance before they enter; after, their weight is Cauchy's. Of the horizontal links
// between two consecutive keyframes one always remains in force: where both are outliers, they are only
// inflated. Fixed memory, bounded work a call; same calls, same result.
//
// A dive may be of any length: when keyframes, links or the solver are full, the keyframe that is missed
// least retires, and so do references that no keyframe uses any more. What hung on it hangs on the nearest
// keyframe in time that is left, where it was.
class NavigationGraph {
 public:
  using Retired = RetiredKeyframe;
  using Prediction = UncertainPose;
  using Counters = NavigationCounters;

  explicit NavigationGraph(const NavigationConfig& config);
  NavigationGraph(const NavigationGraph&) = delete;
  NavigationGraph& operator=(const NavigationGraph&) = delete;

  // Where odom's origin is in nav as far as known when the first keyframe comes
  // (nav - odom, horizontal), and its standard deviation; a kilometre if never
  // given. And as positions of the USBL have it, without what they share.
  void setAnchor(const Eigen::Vector2d& shift, double sigma) { fixes_.setAnchor(shift, sigma); }
  void setUsblAnchor(const Eigen::Vector2d& shift, double sigma) { fixes_.setUsblAnchor(shift, sigma); }

  // The keyframe's number, counting from 0 over the whole dive;
  // std::nullopt when there is no room and none can retire.
  std::optional<int> addKeyframe(const KeyframeInput& input);
  // By the last addKeyframe(), in their order: one may be `onto` of an earlier one.
  [[nodiscard]] std::span<const Retired> retired() const { return retirement_.retired(); }

  // Keyframe b seen from a, with the covariance of covariance(). Of keyframes that step() has taken in.
  [[nodiscard]] Prediction predict(int a, int b) { return fixes_.predict(a, b); }

  // T_a_b of two keyframes' cameras as they saw each other, with the covariance of its right perturbation.
  // Visual odometry of the newest step, before step(), is judged with the step's other sensors. A closure
  // that contradicts what is known is rejected, until `reject_after` that agree with each other say the same.
  // `confirmed`: visual odometry from an earlier keyframe, without dead reckoning as prior, says the same.
  Taken addLink(LinkKind kind, int a, int b, const SE3& seen, const Matrix6d& covariance,
                bool confirmed = false) {
    return links_.add(kind, a, b, seen, covariance, confirmed);
  }
  // Replaces visual odometry of the step to a keyframe: its features are
  // seen through a rig that is known better.
  void renewOdometry(int keyframe, const SE3& seen, const Matrix6d& covariance) {
    turns_.renewOdometry(keyframe, seen, covariance);
  }
  // A position fix of an antenna at `antenna_in_odom`, whenever it arrives: it holds at keyframe `at`, the
  // nearest in time, and odometry gives the path between. `sigma`: of either component [m]. `by_usbl`: shares
  // its shift and turn with all other positions of the USBL (SensorNoise), which are a pose of the graph.
  Taken addFix(int at, const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& north_east,
               double sigma, bool by_usbl) {
    return fixes_.add(at, antenna_in_odom, north_east, sigma, by_usbl);
  }

  // The rig that visual odometry looks through was changed so that its
  // ranges grew by (scale [1], per metre [1/m]); see DvlCalibration.
  void rigChanged(const Eigen::Vector2d& growth) { turns_.rigChanged(growth); }
  // It was measured for the first time, or again after a knock: DvlCalibration::resetRig(). What steps after
  // `since_ns` contradicted was the rig's error, not the DVL's: `knocked`, their visual odometry is rejected.
  void resetRig(double turn_sigma, std::int64_t since_ns, bool knocked);

  // Judges the newest step by all that has come of it; addKeyframe() and step() do so.
  void judge() {
    if (!steps_.judge()) fixes_.noteUnconfirmed(keyframes_.back().utc_ns);
  }
  // A bounded part of the work that is to do.
  StepReport step();

  // So far: the newest has this number less one. Nothing may be asked of a keyframe that has retired.
  [[nodiscard]] int keyframes() const { return keyframes_.next(); }
  [[nodiscard]] bool has(int keyframe) const { return keyframes_.has(keyframe); }
  // Those that have not retired, rising.
  [[nodiscard]] std::span<const int> living() const { return keyframes_.living(); }
  [[nodiscard]] const SE3& pose(int keyframe) const { return keyframes_.pose(keyframe); }  // T_nav_cam
  [[nodiscard]] const SE3& odometry(int keyframe) const { return keyframes_[keyframe].T_odom_cam; }
  [[nodiscard]] std::int64_t utcNs(int keyframe) const { return keyframes_[keyframe].utc_ns; }
  // Of its right perturbation: the graph's, and what links share that it takes for independent. Of their
  // turns (DvlCalibration::curl()) that is what they move each pose by (SharedByPose). Else, to first order,
  // it is an error e of the scale of all paths (SensorNoise::visual_scale, or the DVL's where no image has
  // calibrated it) and one h of their direction (the DVL's mounting likewise), which move a place by e d + h
  // (down x d), d from the middle of the fixes, which hold the survey there; fixes apart from each other
  // estimate e and h in turn.
  [[nodiscard]] Matrix6d covariance(int keyframe) { return fixes_.covariance(keyframe); }
  // From the newest keyframe: where odom is now. By the anchors without keyframes.
  [[nodiscard]] SE3 T_nav_odom() const;
  // Compass deviation at the newest keyframe [rad].
  [[nodiscard]] double deviation() const { return references_.deviation(); }
  // What all positions of the USBL are found to share: where their frame is, less where it was before
  // [m, north and east], and its turn; identity where none has come.
  [[nodiscard]] SE3 usblCorrection() const { return fixes_.usblCorrection(); }
  // Height of the sea over nav's zero at the newest reference of depth, or
  // what the pressure sensor reads too much [m].
  [[nodiscard]] double seaHeight() const { return references_.seaHeight(); }

  // The keyframe that has moved most since its pose was last taken here; std::nullopt when none moved by more
  // than change_m or change_rad. Taking it marks it as known.
  std::optional<int> takeChange() { return keyframes_.takeChange(); }
  // Marks all as known.
  void takeAllChanges() { keyframes_.takeAllChanges(); }
  [[nodiscard]] std::size_t changesWaiting() const { return keyframes_.changesWaiting(); }

  [[nodiscard]] const Counters& counters() const { return keyframes_.counters(); }
  // Whether the newest step, or more before it, contradicts the DVL: the distance that it gives is void.
  [[nodiscard]] bool dvlContradicted() const { return steps_.dvlContradicted(); }

  // Poses and what the sensors alone say of them, as a batch solver takes it: all factors that are in force
  // but links and fixes. Pose 0 is nav's origin. Of a graph of which nothing has retired.
  [[nodiscard]] PoseGraph sensorGraph() const;
  [[nodiscard]] int node(int keyframe) const { return keyframes_[keyframe].node; }
  [[nodiscard]] const DvlCalibration& dvl() const { return dvl_; }
  // Whether the visual odometry of the step to a keyframe is an inlier; true where there is none. And the
  // weight of its information; 0 where there is none.
  [[nodiscard]] bool visualInlier(int keyframe) const { return !keyframes_[keyframe].visualRejected(); }
  [[nodiscard]] double visualWeight(int keyframe) const;
  [[nodiscard]] const IncrementalSolver& solver() const { return keyframes_.solver(); }
  [[nodiscard]] std::size_t memoryBytes() const;

  // Into a graph of the same configuration: every pose bit by bit, the solver's factor built again. A graph
  // whose load() failed is of no use.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  static void exchange(auto& archive, auto& self);
  [[nodiscard]] bool rebuildIndices();  // of what was loaded; false if an index is invalid or used twice
  [[nodiscard]] Keyframe begin(const KeyframeInput& input) const;

  KeyframeStore keyframes_;
  DvlCalibration dvl_;
  RobustFactors robust_;
  SharedTurns turns_;
  SensorReferences references_;
  StepGate steps_;
  FixGate fixes_;
  LinkGate links_;
  KeyframeRetirement retirement_;
};

}  // namespace fathom::slam
