#include "recon/closure/recognition.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace fathom::closure {

Agreement::Agreement() {
  waiting_.reserve(kWaiting + 1);
  agreed_.reserve(kWaiting + 1);
}

// Adds a claim to agreed_ if it agrees with all claims there.
bool Agreement::join(const Claim& claim, const Odometry& odometry) {
  for (const Claim& other : agreed_) {
    const int da = std::abs(other.a - claim.a), db = std::abs(other.b - claim.b);
    if (da + db == 0 || da > kNeighbours || db > kNeighbours) return false;
    const RelativePrior side = odometry(claim.a, other.a), far_side = odometry(claim.b, other.b);
    if (!(cycleDistance2({claim.T_a_b, claim.covariance}, far_side, side, {other.T_a_b, other.covariance}) <
          kCycleGate))
      return false;
  }
  agreed_.push_back(claim);
  return true;
}

std::span<const Claim> Agreement::add(const Claim& claim, const Odometry& odometry) {
  agreed_.assign(1, claim);
  for (std::size_t i = waiting_.size(); i-- > 0;) (void)join(waiting_[i], odometry);
  int wanted = 0;
  bool many_a = false, many_b = false;
  double baseline = 0, span_a = 0, span_b = 0;
  for (const Claim& x : agreed_) {
    wanted = std::max(wanted, x.wanted);
    baseline = std::max(baseline, x.baseline);
    for (const Claim& y : agreed_) {
      if (&x == &y) break;
      many_a = many_a || x.a != y.a;
      many_b = many_b || x.b != y.b;
      span_a = std::max(span_a, odometry(x.a, y.a).T_a_b.translation().norm());
      span_b = std::max(span_b, odometry(x.b, y.b).T_a_b.translation().norm());
    }
  }
  const bool spans = many_a && many_b && std::min(span_a, span_b) >= baseline;
  if (static_cast<int>(agreed_.size()) < wanted || !spans) {
    if (waiting_.size() == kWaiting) {
      waiting_.erase(waiting_.begin());
      ++forgotten_;
    }
    waiting_.push_back(claim);
    return {};
  }
  std::reverse(agreed_.begin(), agreed_.end());
  std::erase_if(waiting_, [&](const Claim& w) {
    return std::any_of(agreed_.begin(), agreed_.end(),
                       [&](const Claim& x) { return x.a == w.a && x.b == w.b; });
  });
  return agreed_;
}

void Agreement::remove(int frame) {
  std::erase_if(waiting_, [&](const Claim& w) { return w.a == frame || w.b == frame; });
}

RegistrationConfig recognitionRules() {
  RegistrationConfig rules;
  rules.min_inliers = 30;
  rules.min_inlier_share = 0.15;
  rules.min_significance = 30;
  return rules;
}

bool fitsDownAndDepth(const SE3& T_nav_a, const SE3& T_nav_b, const SE3& T_a_b) {
  constexpr double kTilt = 0.1;   // between the two directions of down [rad]
  constexpr double kDepth = 0.5;  // residual of the predicted tide between two visits [m]
  const SE3 T_nav_b_found = T_nav_a * T_a_b;
  const Eigen::Vector3d found = T_nav_b_found.rotation().inverse() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d known = T_nav_b.rotation().inverse() * Eigen::Vector3d::UnitZ();
  return std::atan2(found.cross(known).norm(), found.dot(known)) < kTilt &&
         std::abs(T_nav_b_found.translation().z() - T_nav_b.translation().z()) < kDepth;
}

Claim recognitionOf(int a, int b, const UncertainPose& found, int inliers, double radius) {
  constexpr int kWanted = 3;
  constexpr double kBaseline = 0.5;  // radii: over less, both frames show the same objects
  return {a, b, found.T_a_b, found.covariance, inliers, kWanted, kBaseline * radius};
}

}  // namespace fathom::closure
