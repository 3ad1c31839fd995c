#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "recon/closure/registration.hpp"

// Recognition of a place by its looks alone: PlaceIndex proposes a pair of frames, a Registrar of stricter
// rules finds their relative pose without prior, the pose must fit the down and depth of even a lost vehicle,
// and several such pairs must agree.
namespace fathom::closure {

// A relative pose of two frames, of which one may only look like the other place: used once other claims
// confirm it.
struct Claim {
  int a = 0, b = 0;  // frames, the older first
  SE3 T_a_b;
  Matrix6d covariance = Matrix6d::Identity();  // of its right perturbation
  int inliers = 0;
  int wanted = 2;       // claims that must agree, with itself
  double baseline = 0;  // that these must span on either side [m]

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.a, self.b, self.T_a_b, self.covariance, self.inliers, self.wanted, self.baseline);
  }
};

// Claims until others confirm them. Two claims agree when the cycle a - b - b' - a' closes:
//   (T_a_b T_b_b')^-1 (T_a_a' T_a'_b')
// is the identity within the covariances of both and of odometry on either side (99 % of chi-square with 6
// degrees of freedom). Odometry over the short paths a - a' and b - b' is right even where the path from a to
// b is lost. All claims of a set must agree with each other, have different frames on both sides, and span a
// baseline on both: an object that looks like another may fit from several sides, ground does not. Fixed
// memory: when full, the oldest is dropped.
class Agreement {
 public:
  static constexpr int kNeighbours = 6;  // frames within which two claims may agree
  static constexpr std::size_t kWaiting = 64;

  Agreement();

  // Pose of frame y in frame x by odometry, with its covariance.
  using Odometry = std::function<RelativePrior(int x, int y)>;

  // The set that the claim completes, itself the last, which is taken out; empty while too few agree, when
  // the claim is kept. Valid until the next call.
  [[nodiscard]] std::span<const Claim> add(const Claim& claim, const Odometry& odometry);
  // Drops the claims of a frame.
  void remove(int frame);

  [[nodiscard]] std::span<const Claim> waiting() const { return waiting_; }
  [[nodiscard]] std::size_t forgotten() const { return forgotten_; }  // claims dropped when full

  // For saved state (state_archive.hpp), bit by bit.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.bounded(self.waiting_, kWaiting);
    archive(self.forgotten_);
  }

 private:
  [[nodiscard]] bool join(const Claim& claim, const Odometry& odometry);

  std::vector<Claim> waiting_;  // oldest first
  std::vector<Claim> agreed_;
  std::uint64_t forgotten_ = 0;
};

// Stricter than with a prior: more inliers, a larger share of the features in the overlap, and more
// significance.
[[nodiscard]] RegistrationConfig recognitionRules();

// Whether the pose keeps the direction of down and the camera's depth: both are measured absolutely, even
// when position and heading are lost. Poses in nav, of which only down and depth count.
[[nodiscard]] bool fitsDownAndDepth(const SE3& T_nav_a, const SE3& T_nav_b, const SE3& T_a_b);

// Claim of a registration without prior. `radius`: of the frames' footprints [m].
[[nodiscard]] Claim recognitionOf(int a, int b, const UncertainPose& found, int inliers, double radius);

}  // namespace fathom::closure
