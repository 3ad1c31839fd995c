#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "recon/navigation/gating/robust_factors.hpp"
#include "recon/navigation/gating/step_gate.hpp"
#include "recon/navigation/graph/keyframe_store.hpp"

namespace fathom::slam {

enum class Taken : std::uint8_t { kYes, kContradicts, kFull, kBad };

// Where position fixes hold a survey, and how much of an error of its scale or direction they leave. Places
// are north and east in nav [m].
class FixMoments {
 public:
  void add(const Eigen::Vector2d& place, double sigma, bool by_usbl) {
    (by_usbl ? by_usbl_ : alone_).add(place, sigma);
  }
  // Of all; those of a USBL together say no more of a place than what they share, `shared` [m].
  [[nodiscard]] Eigen::Vector2d middle(double shared) const;
  [[nodiscard]] Eigen::Vector2d middleOfUsbl() const { return by_usbl_.middle(); }
  // Covariance of a place so far from the middle by errors that all links share [m^2]: of the scale of paths,
  // and of their direction [rad], by their variances before. `usbl_turn`: that a USBL's fixes share [rad].
  [[nodiscard]] Eigen::Matrix2d errorOf(const Eigen::Vector2d& from_middle, double scale, double direction,
                                        double usbl_turn) const;

  static void exchange(auto& archive, auto& self) { archive(self.alone_, self.by_usbl_); }

 private:
  struct Sums {
    double weight = 0, squares = 0;                 // of 1 / sigma^2, and of place^2 / sigma^2
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();  // of place / sigma^2

    void add(const Eigen::Vector2d& place, double sigma);
    [[nodiscard]] Eigen::Vector2d middle() const { return weight > 0 ? sum / weight : sum; }
    // Information about a scale or turn about the middle.
    [[nodiscard]] double aboutMiddle() const {
      return weight > 0 ? std::max(0.0, squares - sum.squaredNorm() / weight) : 0;
    }
    static void exchange(auto& archive, auto& self) { archive(self.weight, self.squares, self.sum); }
  };
  Sums alone_, by_usbl_;
};

// Position fixes of a navigation graph: the anchor of the first keyframe, the frame of all positions of the
// USBL (a pose of the graph with a shift and a turn that these share), the gate of each fix by the graph's
// covariance, and that covariance with what fixes leave open. Fixes outside the gate are accepted after all
// when they agree with each other for so long that the graph must be wrong: a USBL that is turned, or biased
// by a reflection, stays so for minutes.
class FixGate {
 public:
  FixGate(KeyframeStore& keyframes, const DvlCalibration& dvl, SharedTurns& turns, RobustFactors& robust);

  // As NavigationGraph's.
  void setAnchor(const Eigen::Vector2d& shift, double sigma) { anchor_ = {shift, sigma}; }
  void setUsblAnchor(const Eigen::Vector2d& shift, double sigma) { usbl_anchor_ = {shift, sigma}; }
  Taken add(int keyframe, const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& north_east,
            double sigma, bool by_usbl);
  [[nodiscard]] UncertainPose predict(int a, int b);
  [[nodiscard]] Matrix6d covariance(int keyframe);
  [[nodiscard]] SE3 usblCorrection() const;

  // nav - odom, horizontal, by both anchors [m].
  [[nodiscard]] Eigen::Vector2d startingShift() const;
  // Anchors the first keyframe.
  void anchorFirst(const Keyframe& keyframe, const SE3& T_nav_cam);
  // At this time neither heading nor velocity of the newest step was confirmed by any sensor.
  void noteUnconfirmed(std::int64_t utc_ns) { unconfirmed_ns_ = utc_ns; }

  // For saved state; then rebuildIndices(): false if an index is invalid.
  static void exchangeAnchors(auto& archive, auto& self) {
    archive(self.anchor_, self.usbl_anchor_, self.gauge_, self.usbl_, self.moments_);
  }
  static void exchange(auto& archive, auto& self) {
    archive(self.rejected_, self.unconfirmed_ns_, self.accepted_ns_);
  }
  [[nodiscard]] bool rebuildIndices();
  [[nodiscard]] int usblNode() const { return usbl_.node; }  // -1: none

 private:
  struct Anchor {
    Eigen::Vector2d shift = Eigen::Vector2d::Zero();         // nav - odom [m]
    double sigma = std::numeric_limits<double>::infinity();  // [m]

    static void exchange(auto& archive, auto& self) { archive(self.shift, self.sigma); }
  };
  // The frame of all positions of the USBL: at the first of them, level.
  struct Usbl {
    int node = -1;
    SE3 T_nav_usbl;    // as it was before
    double sigma = 0;  // of what they share, before [m]
    int fixes = 0;     // that were accepted

    static void exchange(auto& archive, auto& self) {
      archive(self.node, self.T_nav_usbl, self.sigma, self.fixes);
    }
  };
  // Fixes outside the gate that agree with each other: how many, since when, and their mean innovation [m].
  struct RejectedRun {
    int fixes = 0;
    std::int64_t since_ns = 0;
    Eigen::Vector2d innovation = Eigen::Vector2d::Zero();

    static void exchange(auto& archive, auto& self) { archive(self.fixes, self.since_ns, self.innovation); }
  };
  // Horizontal covariance of a place so far from one that is held, by errors that all links share [m^2].
  [[nodiscard]] Eigen::Matrix2d sharedError(const Eigen::Vector2d& from_held) const;
  // With more of the place in nav, horizontal [m^2].
  [[nodiscard]] static Matrix6d widened(Matrix6d covariance, const SE3& T_nav_cam, const Eigen::Matrix2d& by);
  [[nodiscard]] double anchorSigma() const;
  void releaseGauge();
  void addUsbl(const Eigen::Vector2d& north_east, double sigma);
  [[nodiscard]] Eigen::Matrix2d spreadOf(int keyframe, const SE3& T_from_cam, double sigma, bool by_usbl);
  [[nodiscard]] bool rejectedAgree(std::int64_t utc_ns, const Eigen::Vector2d& innovation, double sigma);

  KeyframeStore& keyframes_;
  IncrementalSolver& solver_;
  const NavigationConfig& config_;
  const DvlCalibration& dvl_;
  SharedTurns& turns_;
  RobustFactors& robust_;
  Anchor anchor_, usbl_anchor_;
  int gauge_ = -1;  // measurement of the first keyframe's place, while nothing else fixes it
  FixMoments moments_;
  Usbl usbl_;
  RejectedRun rejected_;
  // Last time that no sensor of the chain was accepted; that a fix was inside the gate.
  std::int64_t unconfirmed_ns_ = 0, accepted_ns_ = 0;
};

// kAgreed: a closure that others agree with around a cycle, whatever the graph says.
enum class LinkKind : std::uint8_t { kOdometry, kClosure, kAgreed };

// Gate of visual links: those of the chain wait for StepGate; closures must agree with what the graph
// predicts, or with so many closures that contradicted it that the graph must be wrong.
class LinkGate {
 public:
  LinkGate(KeyframeStore& keyframes, DvlCalibration& dvl, SharedTurns& turns, RobustFactors& robust,
           FixGate& fixes, StepGate& steps, SensorReferences& references);

  // NavigationGraph::addLink().
  Taken add(LinkKind kind, int a, int b, const SE3& seen, const Matrix6d& covariance, bool confirmed);
  [[nodiscard]] std::size_t memoryBytes() const { return displaced_.capacity() * sizeof(int); }

  static void exchange(auto& archive, auto& self) { archive(self.rejected_, self.next_rejected_); }

 private:
  struct Rejected {  // a closure that contradicts the graph
    int a = -1, b = -1;
    UncertainPose link;

    static void exchange(auto& archive, auto& self) {
      archive(self.a, self.b, self.link.T_a_b, self.link.covariance);
    }
  };
  [[nodiscard]] bool agreesWithRejected(int a, int b, const UncertainPose& link);
  void displaceLost(int a, int b, const SE3& T_a_b);

  KeyframeStore& keyframes_;
  DvlCalibration& dvl_;
  SharedTurns& turns_;
  RobustFactors& robust_;
  FixGate& fixes_;
  StepGate& steps_;
  SensorReferences& references_;
  std::vector<int> displaced_;         // nodes
  std::array<Rejected, 16> rejected_;  // the newest, in turn
  std::uint64_t next_rejected_ = 0;
};

}  // namespace fathom::slam
