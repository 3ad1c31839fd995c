#pragma once

#include "recon/navigation/gating/robust_factors.hpp"
#include "recon/navigation/graph/keyframe_store.hpp"
#include "recon/solver/incremental/shared_by_pose.hpp"

namespace fathom::slam {

// Turns that all visual links share because they see through one rig (DvlCalibration::curl()): what steps and
// closures say of them, what they leave open of each pose (SharedByPose), and links that are corrected again
// when the estimate has changed. All is followed in parts, one a step.
class SharedTurns {
 public:
  SharedTurns(KeyframeStore& keyframes, DvlCalibration& dvl, RobustFactors& robust);

  // A keyframe that comes has the errors of the one before, and those of the link between them.
  void hang(int node, int from, const SE3& T_nav_cam, const SharedByPose::Each& link_error);
  void hangKeyframe(int node, int from, const SE3& T_nav_cam);
  // A part of what shared turns do to poses, and of what closures say of them.
  void follow();
  // Of the graph, with what shared turns leave open: of the relative pose of two nodes, and of a node.
  [[nodiscard]] Matrix6d relativeCovariance(int from, int to);
  [[nodiscard]] Matrix6d covariance(int node);
  // By a closure's yaw against visual odometry, if that never failed between the keyframes.
  void learnFromYaw(int a, int b, const UncertainPose& seen);
  // Corrects a closure again when the estimate has changed by a fifth of its standard deviation. Not while
  // the factor lacks newer measurements, which the search for closures would not know.
  void straightenAgain(RobustFactor& factor);
  // As NavigationGraph's.
  void renewOdometry(int number, const SE3& seen, const Matrix6d& covariance);
  void rigChanged(const Eigen::Vector2d& growth) {
    if (dvl_.rigChanged(growth)) ++curl_epoch_;
  }
  void resetRig(double turn_sigma);
  // Times that the rig was reset, and that curl() became another.
  [[nodiscard]] int rigEpoch() const { return rig_epoch_; }
  [[nodiscard]] int curlEpoch() const { return curl_epoch_; }

  // For saved state; then restart(), which computes what shared turns do to the loaded poses.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.rig_epoch_, self.curl_epoch_);
  }
  void restart();
  [[nodiscard]] std::size_t memoryBytes() const { return links_.memoryBytes() + closures_.memoryBytes(); }

 private:
  void pullLinks();
  void pullClosures();
  void learnFromClosures();
  template <typename Take>
  void forLevelTurns(const Take& take) const;
  void forgetReplaced();

  KeyframeStore& keyframes_;
  IncrementalSolver& solver_;
  DvlCalibration& dvl_;
  RobustFactors& robust_;
  SharedByPose links_, closures_;              // curl() by all links, and in roll and pitch by closures
  bool in_closures_ = false, pulled_ = false;  // followed now; all that pulls is in it
  int rig_epoch_ = 0, curl_epoch_ = 0;
};

}  // namespace fathom::slam
