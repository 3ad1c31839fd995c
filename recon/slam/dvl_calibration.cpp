#include "recon/slam/dvl_calibration.hpp"

#include <Eigen/Dense>
#include <cmath>

namespace fathom::slam {
namespace {

constexpr double kGate = 13.8;     // chi-square with 2 degrees of freedom, 99.9 %
constexpr double kLeastWay = 0.1;  // shorter steps tell nothing of scale and heading [m]
constexpr double kForgets = 0.97;  // what a step leaves of the sum of those before
// Of the sum's square over its variance, 1 / (1 - kForgets^2): a chance of 1e-4 with 2 degrees of freedom.
constexpr double kLeans = 20;
constexpr double kChanged = 0.1;  // standard deviation of scale and heading after a change [1], [rad]
constexpr double kWalk = 2e-6;    // of a state over a step, squared it is far below what a step tells

Eigen::Vector2d turnedLeft(const Eigen::Vector2d& d) {
  return {-d.y(), d.x()};
}

}  // namespace

DvlCalibration::DvlCalibration(const SensorNoise& noise, const Eigen::Vector3d& dvl_in_camera,
                               const RigPrior& rig)
    : noise_(noise), dvl_in_camera_(dvl_in_camera), rig_(rig) {
  const double per_metre = std::hypot(rig.principal_point, rig.turn) / rig.baseline;
  covariance_ =
      Eigen::Vector4d(noise.dvl_scale, noise.dvl_heading, rig.scale, per_metre).cwiseAbs2().asDiagonal();
}

void DvlCalibration::rigChanged(const Eigen::Vector2d& growth) {
  constexpr double kOpen = 0.5, kBeyondChance = 3, kRange = 2;  // [1], standard deviations, [m]
  state_.tail<2>() += growth;
  if (std::abs(growth.x() + kRange * growth.y()) > kBeyondChance * rangeSigma(kRange))
    covariance_.diagonal().tail<2>() += (kOpen * growth).cwiseAbs2();
}

void DvlCalibration::rigBeganAnew(double turn_sigma) {
  const double per_metre = std::hypot(rig_.principal_point, turn_sigma) / rig_.baseline;
  state_.tail<2>().setZero();
  covariance_.row(3).setZero();
  covariance_.col(3).setZero();
  covariance_(3, 3) = per_metre * per_metre;
  leaning_.setZero();
}

double DvlCalibration::rangeSigma(double range) const {
  const Eigen::Vector2d by(1, range);
  return std::sqrt(by.dot(covariance_.bottomRightCorner<2, 2>() * by));
}

void DvlCalibration::setSoundShare(double share) {
  if (share == sound_share_) return;
  sound_share_ = share;
  state_(0) = 0;
  covariance_.row(0).setZero();
  covariance_.col(0).setZero();
  covariance_(0, 0) = noise_.dvl_scale * noise_.dvl_scale + share * share;
  leaning_.setZero();
}

bool DvlCalibration::add(const SE3& T_odom_a, const SE3& T_odom_b, const SE3& T_a_b,
                         const Matrix6d& covariance, const StepQuality& quality, double range) {
  const Eigen::Vector2d reckoned = wayOf(T_odom_a, T_odom_b).head<2>();
  if (reckoned.norm() < kLeastWay) return true;
  const SE3 T_odom_seen = T_odom_a * T_a_b;
  const Eigen::Vector2d visual = wayOf(T_odom_a, T_odom_seen).head<2>();
  const Eigen::Matrix3d R_b = T_odom_seen.matrix3();
  const Matrix6d at_dvl = perturbationAt(dvl_in_camera_), seen = at_dvl * covariance * at_dvl.transpose();
  Eigen::Matrix2d noise = (R_b * seen.topLeftCorner<3, 3>() * R_b.transpose()).topLeftCorner<2, 2>();
  // Its own noise but for what is estimated here; heading's turns what the camera saw, across the way.
  StepQuality known = quality;
  known.calibration_share = 0;
  const double step = stepSigma(0, known, noise_);
  noise.diagonal().array() += step * step;
  const Eigen::Vector2d across = turnedLeft(reckoned);
  noise += noise_.heading * noise_.heading * across * across.transpose();

  covariance_.diagonal().array() += kWalk * kWalk;
  Eigen::Matrix<double, 2, 4> H;
  H << reckoned, across, reckoned, range * reckoned;
  const Eigen::Vector2d innovation = visual - reckoned - H * state_;
  const Eigen::Matrix2d S = H * covariance_ * H.transpose() + noise;
  // In the axes of the way, so that what leans to one side does so after a turn of the vehicle too.
  Eigen::Matrix2d to_way;
  to_way << reckoned.transpose(), across.transpose();
  to_way /= reckoned.norm();
  const Eigen::Matrix2d spread = to_way * S * to_way.transpose();
  const Eigen::Vector2d normal = spread.llt().matrixL().solve(to_way * innovation);
  const double distance2 = normal.squaredNorm();
  leaning_ = kForgets * leaning_ + normal * std::min(1.0, std::sqrt(kGate / std::max(distance2, kGate)));
  if (leaning_.squaredNorm() * (1 - kForgets * kForgets) > kLeans) {
    covariance_.topRows<2>().setZero();
    covariance_.leftCols<2>().setZero();
    covariance_.topLeftCorner<2, 2>() = kChanged * kChanged * Eigen::Matrix2d::Identity();
    leaning_.setZero();
    ++restarts_;
    return false;
  }
  if (!(distance2 <= kGate)) {
    ++gated_;
    return false;
  }
  const Eigen::Matrix<double, 4, 2> gain = covariance_ * H.transpose() * S.inverse();
  state_ += gain * innovation;
  const Eigen::Matrix4d left = Eigen::Matrix4d::Identity() - gain * H;
  covariance_ = left * covariance_ * left.transpose() + gain * noise * gain.transpose();
  ++used_;
  return true;
}

SE3 DvlCalibration::corrected(const SE3& T_odom_a, const SE3& T_odom_b) const {
  const Eigen::Vector2d way = wayOf(T_odom_a, T_odom_b).head<2>();
  const Eigen::Vector2d more = (1 + state_(0)) * (Eigen::Rotation2Dd(state_(1)) * way) - way;
  return {T_odom_b.rotation(), T_odom_b.translation() + Eigen::Vector3d(more.x(), more.y(), 0)};
}

double DvlCalibration::remainingShare() const {
  return std::sqrt(covariance_.diagonal().head<2>().maxCoeff());
}

}  // namespace fathom::slam
