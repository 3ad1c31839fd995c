#include "recon/closure/recognition.hpp"

#include <cmath>

namespace fathom::closure {

RegistrationConfig recognitionRules() {
  RegistrationConfig rules;
  rules.min_inliers = 30;
  rules.min_inlier_share = 0.15;
  rules.min_significance = 30;
  return rules;
}

bool fitsDownAndDepth(const SE3& T_nav_a, const SE3& T_nav_b, const SE3& T_a_b) {
  constexpr double kTilt = 0.1;   // between the two directions of down [rad]
  constexpr double kDepth = 0.5;  // a tide between two visits is known so well [m]
  const SE3 T_nav_b_found = T_nav_a * T_a_b;
  const Eigen::Vector3d found = T_nav_b_found.rotation().inverse() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d known = T_nav_b.rotation().inverse() * Eigen::Vector3d::UnitZ();
  return std::atan2(found.cross(known).norm(), found.dot(known)) < kTilt &&
         std::abs(T_nav_b_found.translation().z() - T_nav_b.translation().z()) < kDepth;
}

Claim recognitionOf(int a, int b, const UncertainPose& found, int inliers, double radius) {
  constexpr int kWanted = 3;
  constexpr double kBaseline = 0.5;  // radii: over less, the same things are seen
  return {a, b, found.T_a_b, found.covariance, inliers, kWanted, kBaseline * radius};
}

}  // namespace fathom::closure
