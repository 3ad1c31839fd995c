#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "recon/closure/registration.hpp"

namespace fathom::closure {

// A relative pose of two frames that could be one of several look-alike places: believed when others agree.
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

// Claims that wait for others to agree with them. Two of them agree when the cycle a - b - b' - a' closes:
//   (T_a_b T_b_b')^-1 (T_a_a' T_a'_b')
// is the identity within what the claims and odometry on either side leave open (99 % of chi-square with 6
// degrees of freedom). Odometry of the short ways a - a' and b - b' is right even where the way from a to b
// is lost. All of a set must agree with each other, have different frames on both sides, and span a baseline
// on both: one thing that looks like another may fit from several sides, ground does not. Fixed memory: when
// full the oldest goes.
class Agreement {
 public:
  static constexpr int kNeighbours = 6;  // frames within which two claims may agree
  static constexpr std::size_t kWaiting = 64;

  Agreement();

  // Frame y seen from x as odometry has it, with its covariance.
  using Odometry = std::function<RelativePrior(int x, int y)>;

  // The set that the claim completes, itself the last, which then waits no more; empty when it has to wait.
  // Valid until the next call.
  [[nodiscard]] std::span<const Claim> add(const Claim& claim, const Odometry& odometry);
  // Forgets the claims of a frame.
  void remove(int frame);

  [[nodiscard]] std::span<const Claim> waiting() const { return waiting_; }
  [[nodiscard]] std::size_t forgotten() const { return forgotten_; }  // for want of room

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

}  // namespace fathom::closure
