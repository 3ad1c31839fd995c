#pragma once

#include "recon/navigation/gating/velocity_gate.hpp"
#include "recon/navigation/graph/sensor_references.hpp"

namespace fathom::slam {

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

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
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
