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

// A retired keyframe. Data that were attached to it at the odometry pose T_odom are attached to keyframe
// `onto` at T_onto * T_odom, which leaves their pose in nav as it was: T_onto = odometry(onto) pose(onto)^-1
// pose(keyframe) odometry(keyframe)^-1.
struct RetiredKeyframe {
  int keyframe = 0, onto = 0;
  SE3 T_onto;
};

// Makes room for new keyframes: marginalises the keyframe that adds least information into factors between
// its neighbours (retirement.hpp), and removes references that few measurements use.
class KeyframeRetirement {
 public:
  KeyframeRetirement(KeyframeStore& keyframes, RobustFactors& robust, SensorReferences& references);

  void makeRoom();
  // Keyframes that the last makeRoom() retired, in that order: an entry's keyframe may be the `onto` of an
  // earlier entry.
  [[nodiscard]] std::span<const RetiredKeyframe> retired() const { return retired_; }
  void clear() { retired_.clear(); }

 private:
  [[nodiscard]] bool retireKeyframe();
  void retireReference();
  [[nodiscard]] bool retireNode(int node);
  void removeMeasurement(int measurement, int other_end);

  KeyframeStore& keyframes_;
  RobustFactors& robust_;
  SensorReferences& references_;
  std::vector<RetiredKeyframe> retired_;
};

// The vehicle's navigation as a graph of poses in information form: one pose for each stereo keyframe, and
// references of attitude (compass deviation, bias of roll and pitch) and depth (tide), which vary slowly;
// dead reckoning, attitude, depth, fixes, visual odometry and loop closures are its factors
// (sensor_factors.hpp). View-based (Eustice et al. 2006; Mahon et al. 2008): the vehicle's present pose is
// the newest keyframe's and dead reckoning from there.
//
// This class wires one class for each concern: KeyframeStore (keyframes, their factors, changes),
// SensorReferences, StepGate with HeadingGate and VelocityGate (compass, gyro, DVL, visual odometry),
// FixGate (GPS, USBL, covariances), LinkGate (closures), RobustFactors (weights of links and fixes),
// DvlCalibration and SharedTurns (errors that all steps and links share), KeyframeRetirement.
//
// Each factor that may be an outlier has a weight, set by one of these classes. Closures and fixes must agree
// with the graph's own covariance before they enter; from then on they have Cauchy weights. At least one
// horizontal link (DVL or visual odometry) between two consecutive keyframes remains active: where both are
// outliers, their covariances are only inflated. Memory is fixed and the work of a call bounded; the same
// calls give the same result.
//
// A dive may be of any length: when keyframes, links or the solver are full, the keyframe that adds least
// information retires, and so do references that no keyframe uses any more. Data attached to it are attached
// to the nearest remaining keyframe in time, without moving in nav.
class NavigationGraph {
 public:
  using Retired = RetiredKeyframe;
  using Prediction = UncertainPose;
  using Counters = NavigationCounters;

  explicit NavigationGraph(const NavigationConfig& config);
  NavigationGraph(const NavigationGraph&) = delete;
  NavigationGraph& operator=(const NavigationGraph&) = delete;

  // Prior of the odom origin in nav, set before the first keyframe: horizontal shift (nav - odom) and its
  // standard deviation [m], a kilometre if never set. setUsblAnchor(): the same from positions of the USBL,
  // without the error that all of them share.
  void setAnchor(const Eigen::Vector2d& shift, double sigma) { fixes_.setAnchor(shift, sigma); }
  void setUsblAnchor(const Eigen::Vector2d& shift, double sigma) { fixes_.setUsblAnchor(shift, sigma); }

  // The keyframe's number, counting from 0 over the whole dive; std::nullopt when there is no room and none
  // can retire.
  std::optional<int> addKeyframe(const KeyframeInput& input);
  // Keyframes that the last addKeyframe() retired, in that order: an entry's keyframe may be the `onto` of an
  // earlier entry.
  [[nodiscard]] std::span<const Retired> retired() const { return retirement_.retired(); }

  // T_a_b of the cameras of two keyframes that step() has processed, with its covariance as covariance() has
  // it.
  [[nodiscard]] Prediction predict(int a, int b) { return fixes_.predict(a, b); }

  // Adds the measured T_a_b of two keyframes' cameras, with the covariance of its right perturbation. Visual
  // odometry of the newest step, added before step(), is tested with the step's other sensors. A closure that
  // contradicts the graph is rejected, until `reject_after` closures that agree with each other support it.
  // `confirmed`: visual odometry from an earlier keyframe, matched without dead reckoning as prior, agrees.
  Taken addLink(LinkKind kind, int a, int b, const SE3& seen, const Matrix6d& covariance,
                bool confirmed = false) {
    return links_.add(kind, a, b, seen, covariance, confirmed);
  }
  // Replaces the visual odometry of the step to a keyframe by one computed with an improved rig calibration.
  void renewOdometry(int keyframe, const SE3& seen, const Matrix6d& covariance) {
    turns_.renewOdometry(keyframe, seen, covariance);
  }
  // A position fix of an antenna at `antenna_in_odom`, whenever it arrives: it holds at keyframe `at`, the
  // nearest in time, and odometry gives the path between. `sigma`: of either component [m]. `by_usbl`: all
  // positions of the USBL share one unknown shift and rotation (SensorNoise), which is a pose of the graph.
  Taken addFix(int at, const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& north_east,
               double sigma, bool by_usbl) {
    return fixes_.add(at, antenna_in_odom, north_east, sigma, by_usbl);
  }

  // Takes note that the rig of visual odometry was changed so that its ranges grew by (scale [1], per metre
  // [1/m]); see DvlCalibration.
  void rigChanged(const Eigen::Vector2d& growth) { turns_.rigChanged(growth); }
  // Takes note that the rig was calibrated for the first time, or again after a knock:
  // DvlCalibration::resetRig(). Contradictions between visual odometry and DVL in steps after `since_ns` are
  // attributed to the rig; if `knocked`, the visual odometry of these steps is rejected.
  void resetRig(double turn_sigma, std::int64_t since_ns, bool knocked);

  // Tests the newest step with all data that have come of it; addKeyframe() and step() do so.
  void judge() {
    if (!steps_.judge()) fixes_.noteUnconfirmed(keyframes_.back().utc_ns);
  }
  // Does a bounded amount of pending optimisation.
  StepReport step();

  // How many keyframes were ever added; the newest has this number less one. A keyframe that has retired must
  // not be passed to the functions below, has() excepted.
  [[nodiscard]] int keyframes() const { return keyframes_.next(); }
  [[nodiscard]] bool has(int keyframe) const { return keyframes_.has(keyframe); }
  // Keyframes that have not retired, in increasing order.
  [[nodiscard]] std::span<const int> living() const { return keyframes_.living(); }
  [[nodiscard]] const SE3& pose(int keyframe) const { return keyframes_.pose(keyframe); }  // T_nav_cam
  [[nodiscard]] const SE3& odometry(int keyframe) const { return keyframes_[keyframe].T_odom_cam; }
  [[nodiscard]] std::int64_t utcNs(int keyframe) const { return keyframes_[keyframe].utc_ns; }
  // To the seafloor [m].
  [[nodiscard]] double range(int keyframe) const { return keyframes_[keyframe].range; }
  // Covariance of the right perturbation of a keyframe's pose: the graph's marginal covariance, plus errors
  // that links share although the graph takes them for independent:
  // - their common yaw errors (DvlCalibration::curl()), as they move each pose (SharedByPose);
  // - a common error of scale e (SensorNoise::visual_scale, or the DVL's where no image has calibrated it)
  // and
  //   of heading h (likewise the DVL's mounting). To first order they move a position by e d + h (down x d),
  //   where d is its offset from the centroid of the fixes; fixes far apart bound e and h.
  [[nodiscard]] Matrix6d covariance(int keyframe) { return fixes_.covariance(keyframe); }
  // The present pose of odom in nav, from the newest keyframe; without keyframes from the anchors.
  [[nodiscard]] SE3 T_nav_odom() const;
  // Compass deviation at the newest keyframe [rad].
  [[nodiscard]] double deviation() const { return references_.deviation(); }
  // Estimated error that all positions of the USBL share, relative to its prior: shift [m, north and east]
  // and rotation; identity without positions of the USBL.
  [[nodiscard]] SE3 usblCorrection() const { return fixes_.usblCorrection(); }
  // Height of the sea surface over nav's zero at the newest depth reference, inseparable from an offset of
  // the pressure sensor [m].
  [[nodiscard]] double seaHeight() const { return references_.seaHeight(); }

  // The keyframe that has moved most since its pose was last taken here; std::nullopt when none moved by more
  // than change_m or change_rad. The call marks it as known.
  std::optional<int> takeChange() { return keyframes_.takeChange(); }
  // Marks all as known.
  void takeAllChanges() { keyframes_.takeAllChanges(); }
  [[nodiscard]] std::size_t changesWaiting() const { return keyframes_.changesWaiting(); }

  [[nodiscard]] const Counters& counters() const { return keyframes_.counters(); }
  // Whether the newest step, or several steps up to it, contradict the DVL, so that its distance is not used.
  [[nodiscard]] bool dvlContradicted() const { return steps_.dvlContradicted(); }

  // Poses and all active factors except links and fixes, for a batch solver. Pose 0 is nav's origin. For a
  // graph of which nothing has retired.
  [[nodiscard]] PoseGraph sensorGraph() const;
  [[nodiscard]] int node(int keyframe) const { return keyframes_[keyframe].node; }
  [[nodiscard]] const DvlCalibration& dvl() const { return dvl_; }
  // Whether the visual odometry of the step to a keyframe is an inlier; true where there is none.
  [[nodiscard]] bool visualInlier(int keyframe) const { return !keyframes_[keyframe].visualRejected(); }
  // Weight of the information of that visual odometry; 0 where there is none.
  [[nodiscard]] double visualWeight(int keyframe) const;
  [[nodiscard]] const IncrementalSolver& solver() const { return keyframes_.solver(); }
  [[nodiscard]] std::size_t memoryBytes() const;

  // Saves every pose bit by bit; load(), into a graph of the same configuration, builds the solver's factor
  // again. A graph whose load() failed must not be used.
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
