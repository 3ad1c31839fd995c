#pragma once

#include "recon/navigation/graph/keyframe_store.hpp"

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
// not change it in a second. After `reject_after` such steps in a row it is the other one after all.
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

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.velocity_, self.contradictions_, self.rejected_links_, self.agreements_);
  }

 private:
  void rejectDvlInstead();

  KeyframeStore& keyframes_;
  DvlCalibration& dvl_;
  // Of the newest step, level, ahead and to starboard, by the sensor that was accepted [m/s].
  Eigen::Vector2d velocity_ = Eigen::Vector2d::Zero();
  int contradictions_ = 0, rejected_links_ = 0, agreements_ = 0;  // steps in a row
};

}  // namespace fathom::slam
