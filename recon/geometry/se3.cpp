#include "recon/geometry/se3.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include "realtime/base/numbers/portable_math.hpp"

namespace fathom {
namespace {

constexpr double kSmallAngle = 1e-6;  // [rad] below which the series replace the quotients

// Left Jacobian of SO(3): V in t = V rho.
Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& phi) {
  const double angle = phi.norm();
  const Eigen::Matrix3d k = crossMatrix(phi);
  if (angle < kSmallAngle) return Eigen::Matrix3d::Identity() + 0.5 * k + k * k / 6.0;
  const double a2 = angle * angle;
  return Eigen::Matrix3d::Identity() + (1.0 - std::cos(angle)) / a2 * k +
         (angle - std::sin(angle)) / (a2 * angle) * k * k;
}

}  // namespace

SE3 SE3::fromEuler(double roll, double pitch, double yaw, const Eigen::Vector3d& translation) {
  const Eigen::Quaterniond q = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX());
  return {q, translation};
}

Eigen::Vector3d SE3::euler() const {
  const Eigen::Matrix3d r = matrix3();
  const double cos_pitch = hypotenuse(r(0, 0), r(1, 0));
  const double pitch = std::atan2(-r(2, 0), cos_pitch);
  // At a pitch of a quarter turn only yaw minus (plus) roll is known: all of it is given to yaw.
  constexpr double kSingular = 1e-9;
  if (cos_pitch < kSingular) return {0.0, pitch, std::atan2(-r(0, 1), r(1, 1))};
  return {std::atan2(r(2, 1), r(2, 2)), pitch, std::atan2(r(1, 0), r(0, 0))};
}

SE3 SE3::exp(const Vector6d& twist) {
  const Eigen::Vector3d phi = twist.tail<3>();
  const double half = 0.5 * phi.norm();
  // sin(angle/2)/angle, by series near zero.
  const double s = half < kSmallAngle ? 0.5 - half * half / 12.0 : std::sin(half) / (2.0 * half);
  const Eigen::Quaterniond q(std::cos(half), s * phi.x(), s * phi.y(), s * phi.z());
  return {q, leftJacobian(phi) * twist.head<3>()};
}

Vector6d SE3::log() const {
  Eigen::Quaterniond q = rotation_;
  if (q.w() < 0.0) q.coeffs() = -q.coeffs();
  const double n = q.vec().norm();
  const double factor = n < kSmallAngle ? 2.0 / q.w() : 2.0 * std::atan2(n, q.w()) / n;
  const Eigen::Vector3d phi = factor * q.vec();
  Vector6d twist;
  twist << leftJacobian(phi).partialPivLu().solve(translation_), phi;
  return twist;
}

SE3 SE3::inverse() const {
  const Eigen::Quaterniond q = rotation_.conjugate();
  return {q, -(q * translation_)};
}

SE3 interpolate(const SE3& a, const SE3& b, double s) {
  return {a.rotation().slerp(s, b.rotation()), (1.0 - s) * a.translation() + s * b.translation()};
}

double wrapAngle(double radians) {
  const double wrapped = std::remainder(radians, 2.0 * std::numbers::pi);
  return wrapped <= -std::numbers::pi ? wrapped + 2.0 * std::numbers::pi : wrapped;
}

std::optional<Eigen::Matrix3d> nearestRotation(const Eigen::Matrix3d& r) {
  constexpr double kTolerance = 1e-3;  // real files carry six decimals
  const double off = (r.transpose() * r - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(off <= kTolerance) || r.determinant() < 0) return std::nullopt;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(r, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

Eigen::Matrix4d rigidAlignment(const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to, bool scaled) {
  return Eigen::umeyama(from, to, scaled);
}

}  // namespace fathom
