#pragma once

#include "recon/navigation/graph/keyframe_store.hpp"
#include "recon/navigation/graph/sensor_references.hpp"

namespace fathom::slam {

// Share of a turn by which a step's path is turned in the mean: the
// compass may have jumped at any time of it.
inline constexpr double kMeanTurn = 0.5;

// Visual odometry of the newest step, as the step's gates use it.
struct VisualStep {
  bool linked = false, confirmed = false;
  UncertainPose link;
  SE3 T_a_b;  // before DvlCalibration::straightened()
};

// Gate between the DVL's step and visual odometry, by the velocities that they give: of two that contradict
// each other, the one that changes the velocity more is the outlier, as a vehicle of a hundred kilograms does
// not change it in a second. After `reject_after` such steps in a row it is the other one after all, and
// where the DVL then loses the bottom and the images go on as they did.
class VelocityGate {
 public:
  VelocityGate(KeyframeStore& keyframes, DvlCalibration& dvl) : keyframes_(keyframes), dvl_(dvl) {}

  // Whether visual odometry agrees with the DVL's step in all but yaw: by its own noise, with that of tilt
  // and of the depth sensor at both ends. Compared are the paths of the DVL, which a wrong compass at the end
  // does not turn. `contradiction`: of the compass [rad].
  [[nodiscard]] bool agreesButForYaw(const Keyframe& from, const Keyframe& to, const VisualStep& visual,
                                     double contradiction) const;
  // Sets the step's verdicts on DVL and visual odometry, and those of steps before it that follow from it;
  // steps with an inlier calibrate the DVL.
  void judge(const Keyframe& from, Keyframe& to, const VisualStep& visual);
  // The newest step, or more before it, contradicts the DVL.
  [[nodiscard]] bool dvlContradicted() const {
    return keyframes_.counters().dvl_rejected || contradictions_ > 0 || rejected_links_ > 0;
  }
  // After the rig was reset: what contradicted the DVL was the rig's error.
  void reset();

  static void exchange(auto& archive, auto& self) {
    archive(self.velocity_, self.unseen_s_, self.contradictions_, self.rejected_links_, self.agreements_);
  }

 private:
  void rejectDvlInstead();
  // A step that neither images nor bottom track measure goes on with the newest velocity.
  void bridge(const Keyframe& from, const Keyframe& to, double elapsed);

  KeyframeStore& keyframes_;
  DvlCalibration& dvl_;
  // Of the newest step, level, ahead and to starboard, by the sensor that was accepted [m/s].
  Eigen::Vector2d velocity_ = Eigen::Vector2d::Zero();
  double unseen_s_ = 1000;                                        // since then; long ago at first [s]
  int contradictions_ = 0, rejected_links_ = 0, agreements_ = 0;  // steps in a row
};

// Outlier gating of the chain of keyframes: compass, gyro, DVL and visual odometry of each step against each
// other (HeadingGate, VelocityGate), before any pose is solved for, so that an outlier cannot bend the poses
// that judge it; and the weights of the step's factors that follow.
class StepGate {
 public:
  StepGate(KeyframeStore& keyframes, DvlCalibration& dvl, SensorReferences& references);

  // A keyframe came that has one before it: its step waits until judge().
  void beginStep() { waits_ = true; }
  [[nodiscard]] bool waits() const { return waits_; }
  // Visual odometry of that step: as seen, and straightened (DvlCalibration) in `link`.
  void setLink(const UncertainPose& link, const SE3& seen, bool confirmed) {
    visual_ = {true, confirmed, link, seen};
  }
  // Judges the step that waits. False when neither its heading nor its velocity is by an accepted sensor.
  bool judge();
  // After the rig was reset, of steps since a time: their DVL is accepted; `knocked`: visual odometry is not.
  void resetRig(std::int64_t since_ns, bool knocked);
  [[nodiscard]] bool dvlContradicted() const { return velocity_.dvlContradicted(); }

  static void exchange(auto& archive, auto& self) {
    archive(self.heading_, self.waits_, self.visual_.linked, self.visual_.confirmed, self.visual_.link.T_a_b,
            self.visual_.link.covariance, self.visual_.T_a_b, self.velocity_);
  }

 private:
  [[nodiscard]] StepTurns turnsOf(const Keyframe& from, const Keyframe& to) const;
  void addGyro(const Keyframe& from, const Keyframe& to, const StepTurns& turns);
  void takeVerdicts(int keyframe);

  KeyframeStore& keyframes_;
  SensorReferences& references_;
  HeadingGate heading_;
  VelocityGate velocity_;
  bool waits_ = false;
  VisualStep visual_;  // of the newest step, until it is judged
};

}  // namespace fathom::slam
