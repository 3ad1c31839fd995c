#pragma once

#include <span>
#include <vector>

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

}  // namespace fathom::slam
