#include "recon/navigation/sensors/dvl_calibration.hpp"

#include <Eigen/Dense>
#include <cmath>

#include "realtime/base/numbers/portable_math.hpp"

namespace fathom::slam {
namespace {

constexpr double kStepGate = 13.8;     // chi-square with 2 degrees of freedom, 99.9 %
constexpr double kTurnGate = 10.8;     // chi-square with 1 degree of freedom, 99.9 %
constexpr double kLeastPath = 0.1;     // shorter steps do not measure scale and heading [m]
constexpr double kDriftMemory = 0.97;  // what a step leaves of the sum of those before
// Of the sum's square over its variance, 1 / (1 - kDriftMemory^2): a
// chance of 1e-4 with 2 degrees of freedom.
constexpr double kDriftTest = 20;
constexpr double kChanged = 0.1;  // standard deviation of scale and heading after a change [1], [rad]
constexpr double kWalk = 2e-6;    // of a state over a step, squared it is far below the variance of a step

Eigen::Vector2d turnedLeft(const Eigen::Vector2d& d) {
  return {-d.y(), d.x()};
}

// In b's axes.
Eigen::Vector3d pathInB(const SE3& T_a_b) {
  return T_a_b.rotation().conjugate() * T_a_b.translation();
}

// How far ground at a place in a camera's axes seems turned by xx, xy, yy, w: m(p).
Eigen::Matrix<double, 3, 4> apparentTurn(const Eigen::Vector3d& p) {
  Eigen::Matrix<double, 3, 4> out;
  out << 0, -p.x(), -p.y(), 0, p.x(), p.y(), 0, 0, 0, 0, 0, -p.y();
  return out;
}

// The middle of the ground that both saw, in b's axes.
Eigen::Vector3d groundOf(const SE3& T_a_b, double range) {
  const Eigen::Vector3d ahead(0, 0, range);
  return 0.5 * (ahead + T_a_b.inverse() * ahead);
}

// Right perturbation of T_a_b where all ground seems tilted by (u, v) in a camera's axes.
Eigen::Matrix<double, 6, 2> tiltedBy(const SE3& T_a_b, double range) {
  const Eigen::Matrix<double, 3, 2> tilt = range * Eigen::Matrix<double, 3, 2>::Identity();
  return perturbationAt(-groundOf(T_a_b, range)).rightCols<3>() * (T_a_b.matrix3().transpose() * tilt - tilt);
}

// The DVL's place, level, and the camera's turn, by the right perturbation of a camera turned by R.
Eigen::Matrix<double, 5, 6> placeAndTurn(const Eigen::Matrix3d& R) {
  Eigen::Matrix<double, 5, 6> out = Eigen::Matrix<double, 5, 6>::Zero();
  out.topLeftCorner<2, 3>() = R.topRows<2>();
  out.bottomRightCorner<3, 3>() = R;
  return out;
}

}  // namespace

Eigen::Matrix<double, 6, 4> turnedBy(const SE3& T_a_b, double range, const Eigen::Matrix3d& part) {
  const Eigen::Vector3d ground = groundOf(T_a_b, range);
  return perturbationAt(-ground).rightCols<3>() * part *
         (T_a_b.matrix3().transpose() * apparentTurn(T_a_b * ground) - apparentTurn(ground));
}

VisualTurn::VisualTurn(const SE3& T_a_b, const Matrix6d& covariance, int rig_seen)
    : turn(T_a_b.rotation()), variance(covariance.diagonal().tail<3>()), rig(rig_seen) {}

DvlCalibration::DvlCalibration(const SensorNoise& noise, const Eigen::Vector3d& dvl_in_camera,
                               const RigPrior& rig)
    : noise_(noise), dvl_in_camera_(dvl_in_camera), rig_(rig) {
  const double per_metre = hypotenuse(rig.principal_point, rig.turn) / rig.baseline;
  State sigma;
  sigma << noise.dvl_scale, noise.dvl_heading, rig.scale, per_metre, rig.curl, rig.curl, rig.curl, rig.spin,
      rig.ground_tilt, rig.ground_tilt, noise.tilt, noise.tilt;
  steps_.covariance = sigma.cwiseAbs2().asDiagonal();
  join();
}

bool DvlCalibration::rigChanged(const Eigen::Vector2d& growth) {
  // Of the turn by a principal point that is wrong: 0.008 rad/m come with ranges 2 % too long [1/m]; three
  // times as much along the baseline.
  constexpr double kTurns = 0.4, kRange = 2, kAlong = 3;  // [1/m], [m], [1]
  steps_.state.segment<2>(2) += growth;
  const double open = kTurns * (growth.x() + kRange * growth.y());
  steps_.covariance(kCurl, kCurl) += kAlong * kAlong * open * open;
  steps_.covariance(kCurl + 2, kCurl + 2) += open * open;
  const bool is_void = open * open > all_.covariance(kCurl + 2, kCurl + 2);
  if (is_void) closures_information_.setZero(), closures_sum_.setZero();
  join();
  return is_void;
}

void DvlCalibration::resetRig(double turn_sigma) {
  constexpr int kOfRig = 7;  // e, xx, xy, yy, w, u, v
  const double per_metre = hypotenuse(rig_.principal_point, turn_sigma) / rig_.baseline,
               curl = rig_.curl * rig_.curl, tilt = rig_.ground_tilt * rig_.ground_tilt;
  steps_.state.segment<1 + kOfRig>(kCurl - 2).setZero();  // b too
  steps_.covariance.middleRows<kOfRig>(kCurl - 1).setZero();
  steps_.covariance.middleCols<kOfRig>(kCurl - 1).setZero();
  steps_.covariance.diagonal().segment<kOfRig>(kCurl - 1) << per_metre * per_metre, curl, curl, curl,
      rig_.spin * rig_.spin, tilt, tilt;
  drift_.setZero();
  closures_information_.setZero();
  closures_sum_.setZero();
  join();
}

SE3 DvlCalibration::straightened(const SE3& T_a_b, double range) const {
  return T_a_b * SE3::exp(-(turnedBy(T_a_b, range) * curl()));
}

Matrix6d DvlCalibration::leftOpen(const SE3& T_a_b, double range) const {
  const Eigen::Vector3d longer = rangeSigma(range) * pathInB(T_a_b);
  const auto turned = turnedBy(T_a_b, range);
  Matrix6d out = turned * curlCovariance() * turned.transpose();
  out.topLeftCorner<3, 3>() += longer * longer.transpose();
  return out;
}

double DvlCalibration::rangeSigma(double range) const {
  const Eigen::Vector2d by(1, range);
  return std::sqrt(by.dot(all_.covariance.block<2, 2>(2, 2) * by));
}

void DvlCalibration::setSoundShare(double share) {
  if (share == sound_share_) return;
  sound_share_ = share;
  steps_.state(0) = 0;
  steps_.covariance.row(0).setZero();
  steps_.covariance.col(0).setZero();
  steps_.covariance(0, 0) = noise_.dvl_scale * noise_.dvl_scale + share * share;
  drift_.setZero();
  join();
}

bool DvlCalibration::add(const SE3& T_odom_a, const SE3& T_odom_b, const SE3& T_a_b,
                         const Matrix6d& covariance, const StepQuality& quality, double range) {
  constexpr int kAll = kStates + 2, kRows = 5;  // with the reading at b; path, roll, pitch, yaw
  using Vector5d = Eigen::Matrix<double, kRows, 1>;
  const Eigen::Vector2d reckoned = pathOf(T_odom_a, T_odom_b).head<2>();
  const double path = reckoned.norm();
  if (path < kLeastPath) return true;
  const SE3 T_odom_seen = T_odom_a * T_a_b;
  const Eigen::Vector2d visual = pathOf(T_odom_a, T_odom_seen).head<2>(), across = turnedLeft(reckoned);
  const Eigen::Quaterniond off = T_odom_seen.rotation() * T_odom_b.rotation().conjugate();
  const Eigen::Vector3d turn = SE3(off, Eigen::Vector3d::Zero()).log().tail<3>();
  const Eigen::Matrix<double, kRows, 6> measured =
      placeAndTurn(T_odom_seen.matrix3()) * perturbationAt(dvl_in_camera_);
  Eigen::Matrix<double, kRows, kRows> noise = measured * covariance * measured.transpose();
  // Its own noise but for what is estimated here; heading's turns what the camera saw, across the path. The
  // bias of roll and pitch turns with the body, and the compass's deviation.
  StepQuality known = quality;
  known.calibration_share = 0;
  const double step = stepSigma(0, known, noise_), turned = noise_.tilt_bias * quality.turn,
               yawed =
                   hypotenuse(std::sqrt(2) * noise_.heading, noise_.deviation_turn * std::sqrt(quality.turn));
  noise.topLeftCorner<2, 2>() += noise_.heading * noise_.heading * across * across.transpose();
  noise.diagonal() += Vector5d(step, step, turned, turned, yawed).cwiseAbs2();

  steps_.covariance.diagonal().array() += kWalk * kWalk;
  beginAt(T_odom_a);
  Eigen::Matrix<double, kAll, kAll> joint = Eigen::Matrix<double, kAll, kAll>::Zero();
  joint.topLeftCorner<kStates, kStates>() = steps_.covariance;
  joint.bottomRightCorner<2, 2>() = noise_.tilt * noise_.tilt * Eigen::Matrix2d::Identity();
  Eigen::Matrix<double, kRows, kAll> H = Eigen::Matrix<double, kRows, kAll>::Zero();
  H.topLeftCorner<2, kCurl>() << reckoned, across, reckoned, range * reckoned;
  H.middleCols<4>(kCurl) = measured * turnedBy(T_a_b, range);
  H.middleCols<2>(kTilt) = measured * tiltedBy(T_a_b, range);
  H.block<2, 2>(2, kReading).setIdentity();
  H.block<2, 2>(2, kStates) = -Eigen::Matrix2d::Identity();
  Vector5d innovation;
  innovation << visual - reckoned, turn;
  innovation -= H.leftCols<kStates>() * steps_.state;
  Eigen::Matrix<double, kRows, kRows> S = H * joint * H.transpose() + noise;
  const auto openUnlessItFits = [&](int first, int rows) {
    constexpr double kOpen = 1;  // [rad]
    const auto squares = innovation.segment(first, rows).array().square();
    if (quality.seconds_untilted <= 0 &&
        (squares <= kTurnGate * S.diagonal().segment(first, rows).array()).all())
      return;
    noise.diagonal().segment(first, rows).array() += kOpen * kOpen;
    S.diagonal().segment(first, rows).array() += kOpen * kOpen;
  };
  openUnlessItFits(2, 2);
  openUnlessItFits(4, 1);
  // In the axes of the path, so that a bias keeps its side when the vehicle turns.
  Eigen::Matrix2d to_path;
  to_path << reckoned.transpose(), across.transpose();
  to_path /= path;
  const Eigen::Matrix2d spread = to_path * S.topLeftCorner<2, 2>() * to_path.transpose();
  if (!passes(spread.llt().matrixL().solve(to_path * innovation.head<2>()))) return false;
  const Eigen::Matrix<double, kAll, kRows> gain = joint * H.transpose() * S.inverse();
  const Eigen::Matrix<double, kAll, kAll> left = Eigen::Matrix<double, kAll, kAll>::Identity() - gain * H;
  joint = (left * joint * left.transpose() + gain * noise * gain.transpose()).eval();
  // The reading at b takes the place of that at a.
  steps_.state += gain.topRows<kStates>() * innovation;
  steps_.state.tail<2>() = gain.bottomRows<2>() * innovation;
  steps_.covariance = joint.topLeftCorner<kStates, kStates>();
  steps_.covariance.rightCols<2>().topRows<kReading>() = joint.topRightCorner<kReading, 2>();
  steps_.covariance.bottomRows<2>().leftCols<kReading>() = joint.bottomLeftCorner<2, kReading>();
  steps_.covariance.bottomRightCorner<2, 2>() = joint.bottomRightCorner<2, 2>();
  T_odom_read_ = T_odom_b;
  ++used_;
  join();
  return true;
}

// Whether a step, its innovation divided by its standard deviation, is no outlier. Steps that are biased
// together begin scale and heading again.
bool DvlCalibration::passes(const Eigen::Vector2d& normal) {
  const double distance2 = normal.squaredNorm();
  drift_ =
      kDriftMemory * drift_ + normal * std::min(1.0, std::sqrt(kStepGate / std::max(distance2, kStepGate)));
  if (drift_.squaredNorm() * (1 - kDriftMemory * kDriftMemory) > kDriftTest) {
    steps_.covariance.topRows<2>().setZero();
    steps_.covariance.leftCols<2>().setZero();
    steps_.covariance.topLeftCorner<2, 2>() = kChanged * kChanged * Eigen::Matrix2d::Identity();
    drift_.setZero();
    ++restarts_;
    join();
    return false;
  }
  if (!(distance2 <= kStepGate)) {
    ++gated_;
    return false;
  }
  return true;
}

void DvlCalibration::addTurn(double turn, double variance, const Eigen::RowVector4d& by) {
  const State shared = steps_.covariance.middleCols<4>(kCurl) * by.transpose();
  const double off = turn - by * steps_.state.segment<4>(kCurl), S = by * shared.segment<4>(kCurl) + variance;
  if (!(off * off <= kTurnGate * S)) return;
  steps_.state += shared * (off / S);
  steps_.covariance -= (shared * shared.transpose() / S).eval();
  join();
}

void DvlCalibration::setClosures(const Eigen::Matrix4d& information, const Eigen::Vector4d& sum) {
  closures_information_ = 0.5 * (information + information.transpose());
  closures_sum_ = sum + closures_information_ * curl();
  join();
}

// Joins steps and closures without the inverse of the closures' information, which may be 0.
void DvlCalibration::join() {
  const auto shared = steps_.covariance.middleCols<4>(kCurl);
  const Eigen::Matrix4d& L = closures_information_;
  const Eigen::Matrix4d left = (Eigen::Matrix4d::Identity() + L * shared.middleRows<4>(kCurl)).inverse();
  all_.state = steps_.state + shared * (left * (closures_sum_ - L * steps_.state.segment<4>(kCurl)));
  all_.covariance = steps_.covariance - shared * (left * L) * shared.transpose();
}

// Steps that were left out leave another reading.
void DvlCalibration::beginAt(const SE3& T_odom_a) {
  if (T_odom_read_.translation() == T_odom_a.translation() &&
      T_odom_read_.rotation().coeffs() == T_odom_a.rotation().coeffs())
    return;
  steps_.state.tail<2>().setZero();
  steps_.covariance.bottomRows<2>().setZero();
  steps_.covariance.rightCols<2>().setZero();
  steps_.covariance.bottomRightCorner<2, 2>() = noise_.tilt * noise_.tilt * Eigen::Matrix2d::Identity();
}

SE3 DvlCalibration::corrected(const SE3& T_odom_a, const SE3& T_odom_b) const {
  const Eigen::Vector2d path = pathOf(T_odom_a, T_odom_b).head<2>();
  const Eigen::Vector2d more = (1 + all_.state(0)) * (Eigen::Rotation2Dd(all_.state(1)) * path) - path;
  return {T_odom_b.rotation(), T_odom_b.translation() + Eigen::Vector3d(more.x(), more.y(), 0)};
}

}  // namespace fathom::slam
