#include "recon/lighting/tilt_response.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace fathom::lighting {
namespace {

constexpr float kGross = 3.0F;  // times or a part of what was expected: no matter of tilt

// What the three unknowns are multiplied by, beyond 1.
Eigen::Vector3f factors(const RangeLattice::Ground& ground) {
  const float depth = ground.point.z();
  return {-ground.normal.dot(ground.point) / depth - 1, ground.normal.x() / depth, ground.normal.y() / depth};
}

}  // namespace

void TiltResponse::add(const RangeLattice::Ground& ground, float ratio) {
  if (!(ratio > 1 / kGross && ratio < kGross) || !(ground.point.z() > 0)) return;
  const Eigen::Vector3d f = factors(ground).cast<double>();
  normal_ += f * f.transpose();
  right_ += f * (static_cast<double>(ratio) - 1);
}

void TiltResponse::solve() {
  constexpr double kPatch = 0.3;     // spread of what patches return beside tilt
  constexpr double kAlike = 50;      // patches that share their ground with others
  constexpr double kStrength = 0.3;  // prior, about 1
  constexpr double kAside = 0.5;     // prior, about the camera [m]
  const double weight = 1 / (kPatch * kPatch * kAlike);
  const Eigen::Vector3d prior(1 / (kStrength * kStrength), 1 / (kAside * kAside), 1 / (kAside * kAside));
  Eigen::Matrix3d a = weight * normal_;
  a.diagonal() += prior;
  const Eigen::Vector3d b = weight * right_ + prior.x() * Eigen::Vector3d::UnitX();
  const Eigen::Vector3d x = a.ldlt().solve(b);
  if (!x.allFinite()) return;
  solution_ = {static_cast<float>(std::clamp(x.x(), 0.0, 1.5)), static_cast<float>(x.y()),
               static_cast<float>(x.z())};
}

void TiltResponse::halve() {
  normal_ /= 2;
  right_ /= 2;
}

float TiltResponse::at(const RangeLattice::Ground& ground) const {
  if (!(ground.point.z() > 0)) return 1;
  return std::clamp(1 + solution_.dot(factors(ground)), kDarkest, kBrightest);
}

}  // namespace fathom::lighting
