#include "recon/slam/dvl_calibration.hpp"

#include <Eigen/Dense>
#include <cmath>

namespace fathom::slam {
namespace {

constexpr double kGate = 13.8;      // chi-square with 2 degrees of freedom, 99.9 %
constexpr double kTurnGate = 10.8;  // chi-square with 1 degree of freedom, 99.9 %
constexpr double kLeastWay = 0.1;   // shorter steps tell nothing of scale and heading [m]
constexpr double kForgets = 0.97;   // what a step leaves of the sum of those before
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
  Vector5d sigma;
  sigma << noise.dvl_scale, noise.dvl_heading, rig.scale, per_metre, rig.curl;
  covariance_ = sigma.cwiseAbs2().asDiagonal();
}

void DvlCalibration::rigChanged(const Eigen::Vector2d& growth) {
  // Of the turn by a principal point that is wrong: 0.008 rad/m come with ranges 2 % too long [1/m].
  constexpr double kTurns = 0.4, kRange = 2;  // [1/m], [m]
  state_.segment<2>(2) += growth;
  const double open = kTurns * (growth.x() + kRange * growth.y());
  covariance_(4, 4) += open * open;
}

void DvlCalibration::rigBeganAnew(double turn_sigma) {
  const double per_metre = std::hypot(rig_.principal_point, turn_sigma) / rig_.baseline;
  state_.tail<3>().setZero();
  covariance_.bottomRows<2>().setZero();
  covariance_.rightCols<2>().setZero();
  covariance_(3, 3) = per_metre * per_metre;
  covariance_(4, 4) = rig_.curl * rig_.curl;
  leaning_.setZero();
}

double DvlCalibration::rangeSigma(double range) const {
  const Eigen::Vector2d by(1, range);
  return std::sqrt(by.dot(covariance_.block<2, 2>(2, 2) * by));
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
  const double way = reckoned.norm();
  if (way < kLeastWay) return true;
  const SE3 T_odom_seen = T_odom_a * T_a_b;
  const Eigen::Vector2d visual = wayOf(T_odom_a, T_odom_seen).head<2>();
  const Eigen::Matrix3d R_b = T_odom_seen.matrix3();
  const Eigen::Vector2d across = turnedLeft(reckoned);
  const Eigen::Vector3d axis(across.x() / way, across.y() / way, 0);
  const Eigen::Quaterniond off = T_odom_seen.rotation() * T_odom_b.rotation().conjugate();
  const double turn = SE3(off, Eigen::Vector3d::Zero()).log().tail<3>().dot(axis);
  const Matrix6d at_dvl = perturbationAt(dvl_in_camera_), seen = at_dvl * covariance * at_dvl.transpose();
  Eigen::Matrix<double, 3, 6> measured = Eigen::Matrix<double, 3, 6>::Zero();
  measured.topLeftCorner<2, 3>() = R_b.topRows<2>();
  measured.bottomRightCorner<1, 3>() = axis.transpose() * R_b;
  Eigen::Matrix3d noise = measured * seen * measured.transpose();
  // Its own noise but for what is estimated here; heading's turns what the camera saw, across the way.
  StepQuality known = quality;
  known.calibration_share = 0;
  const double step = stepSigma(0, known, noise_);
  noise.diagonal().head<2>().array() += step * step;
  noise.topLeftCorner<2, 2>() += noise_.heading * noise_.heading * across * across.transpose();
  noise(2, 2) += 2 * noise_.tilt * noise_.tilt;  // of both ends

  covariance_.diagonal().array() += kWalk * kWalk;
  // The turn is about the middle of the ground that was seen.
  const Eigen::Vector3d arm = axis.cross(R_b * (dvl_in_camera_ - range * Eigen::Vector3d::UnitZ()));
  Eigen::Matrix<double, 3, 5> H = Eigen::Matrix<double, 3, 5>::Zero();
  H.topRows<2>() << reckoned, across, reckoned, range * reckoned, way * arm.head<2>();
  H(2, 4) = way;
  Eigen::Vector3d innovation;
  innovation << visual - reckoned, turn;
  innovation -= H * state_;
  constexpr double kOpen = 1;  // [rad]
  const double turn_variance = way * way * covariance_(4, 4) + noise(2, 2);
  if (quality.seconds_untilted > 0 || !(innovation(2) * innovation(2) <= kTurnGate * turn_variance))
    noise(2, 2) += kOpen * kOpen;
  const Eigen::Matrix3d S = H * covariance_ * H.transpose() + noise;
  // In the axes of the way, so that what leans to one side does so after a turn of the vehicle too.
  Eigen::Matrix2d to_way;
  to_way << reckoned.transpose(), across.transpose();
  to_way /= way;
  const Eigen::Matrix2d spread = to_way * S.topLeftCorner<2, 2>() * to_way.transpose();
  const Eigen::Vector2d normal = spread.llt().matrixL().solve(to_way * innovation.head<2>());
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
  const Eigen::Matrix<double, 5, 3> gain = covariance_ * H.transpose() * S.inverse();
  state_ += gain * innovation;
  const Matrix5d left = Matrix5d::Identity() - gain * H;
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
