#pragma once

#include <span>
#include <vector>

#include "recon/navigation/graph/keyframe_store.hpp"
#include "recon/solver/incremental/shared_by_pose.hpp"
#include "recon/solver/measurements.hpp"

namespace fathom::slam {

class SharedTurns;

// A link or a fix that was accepted, with its robust weight.
struct RobustFactor {
  int from = kWorld, to = 0;  // nodes
  SE3 T_from_to;
  Matrix6d spread;  // a link's covariance, of which its information follows; a fix's information
  int measurement = 0;
  double free_chi2 = 0;  // up to there its weight is 1
  double weight = 1;
  bool fix = false, off = false;
  bool confirmed = false;                                     // independently, by others: its weight stays 1
  Eigen::Vector4d straightened_by = Eigen::Vector4d::Zero();  // DvlCalibration::curl() taken out of a link
  int curl_epoch = 0;                                         // SharedTurns::curlEpoch() when it was seen

  [[nodiscard]] RelativePose factor() const {
    return fix ? RelativePose{from, to, T_from_to, spread} : linkFactor(from, to, T_from_to, spread);
  }

  static void exchange(auto& archive, auto& self) {
    archive(self.from, self.to, self.T_from_to, self.measurement, self.free_chi2, self.weight, self.fix,
            self.off, self.confirmed, self.straightened_by, self.curl_epoch);
    exchangeSymmetric(archive, self.spread);
  }
};

// The links between keyframes that are not neighbours, closures among them,
// and the fixes of a navigation graph: Cauchy's weight by their residuals,
// which switches off what the rest contradicts and on again. Fixed memory.
class RobustFactors {
 public:
  explicit RobustFactors(KeyframeStore& keyframes);

  [[nodiscard]] bool isFull() const { return factors_.size() == factors_.capacity(); }
  // Fewer than `spare` places are free.
  [[nodiscard]] bool isShort(std::size_t spare) const;
  [[nodiscard]] bool has(int measurement) const { return place_of_[at(measurement)] >= 0; }
  [[nodiscard]] std::span<const RobustFactor> all() const { return factors_; }
  void add(const RobustFactor& factor);
  // Its measurement in the solver is another from now on.
  void replaceMeasurement(RobustFactor& factor, int measurement);
  // The measurement went with a pose.
  void forget(int measurement);

  // Weights of the newest factors and of some older ones in turn. A factor is switched off only by poses
  // that are at rest (`settled`), and on again when it would pass the gate of a new one.
  void reweight(bool settled, SharedTurns& turns);

  // For saved state; then rebuildIndices(): false if an index is invalid or used twice.
  static void exchangeTurn(auto& archive, auto& self) { archive(self.next_, self.newest_); }
  static void exchange(auto& archive, auto& self) {
    archive.bounded(self.factors_, self.factors_.capacity());
  }
  [[nodiscard]] bool rebuildIndices();
  [[nodiscard]] std::size_t memoryBytes() const {
    return factors_.capacity() * sizeof(RobustFactor) + place_of_.size() * sizeof(int);
  }

 private:
  void reweight(RobustFactor& factor, bool settled, SharedTurns& turns);
  [[nodiscard]] bool passesGate(const RobustFactor& factor, SharedTurns& turns) const;
  void move(std::size_t from, std::size_t to);

  KeyframeStore& keyframes_;
  std::vector<RobustFactor> factors_;
  std::vector<int> place_of_;  // of a measurement, in factors_; -1: none
  // The one to be looked at next, and the first of those that have not been looked at yet.
  std::size_t next_ = 0, newest_ = 0;
};

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
  static void exchange(auto& archive, auto& self) { archive(self.rig_epoch_, self.curl_epoch_); }
  void restart();
  [[nodiscard]] std::size_t memoryBytes() const { return links_.memoryBytes() + closures_.memoryBytes(); }

 private:
  void pullLinks();
  void pullClosures();
  void learnFromClosures();
  void forLevelTurns(const auto& take) const;
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
