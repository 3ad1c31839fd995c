#include "recon/navigation/sensors/sensor_factors.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"

namespace fathom::slam {
namespace {

constexpr double kUnknown = 1e6;     // standard deviation of what is not measured [m], [rad]
constexpr double kHeld = 1e-3;       // of what is fixed by definition [m], [rad]
constexpr double kLevel = 1e-6;      // of what is level [rad]
constexpr double kSlopeOfRate = 60;  // a metre along a tide's x axis stands for so long [s/m]
// Random walk of a tide's rate, of its standard deviation at first: 0.24
// mm/s in an hour, as the fastest's [s^(-1/2)].
constexpr double kTideWalk = 0.0133;
constexpr double kLooseVertical = 1.0;  // of a step [m]: many times any relief between two poses
constexpr double kTilts = 3;        // biases of tilt, which all steps of a line share, that each counts for
constexpr double kLooseTurn = 0.5;  // of a step [rad]

// Standard deviations along the axes of `from`, for a residual in the axes of the measured pose.
RelativePose measured(int from, int to, const SE3& T_from_to, const Eigen::Vector3d& position,
                      const Eigen::Vector3d& rotation) {
  const Eigen::Matrix3d R = T_from_to.matrix3();
  Matrix6d information = Matrix6d::Zero();
  information.topLeftCorner<3, 3>() = R.transpose() * position.cwiseAbs2().cwiseInverse().asDiagonal() * R;
  information.bottomRightCorner<3, 3>() =
      R.transpose() * rotation.cwiseAbs2().cwiseInverse().asDiagonal() * R;
  return {from, to, T_from_to, residualInformation(information)};
}

Eigen::Vector3d all(double sigma) {
  return Eigen::Vector3d::Constant(sigma);
}

}  // namespace

void SensorNoise::validate() const {
  using Named = std::pair<const char*, double>;
  const Named positive[] = {{"dvl_velocity", dvl_velocity}, {"dvl_rate", dvl_rate},
                            {"dvl_scale", dvl_scale},       {"dvl_heading", dvl_heading},
                            {"dvl_place", dvl_place},       {"unknown_velocity", unknown_velocity},
                            {"heading", heading},           {"tilt", tilt},
                            {"deviation", deviation},       {"tilt_bias", tilt_bias},
                            {"unknown_turn", unknown_turn}, {"depth", depth},
                            {"gyro_walk", gyro_walk}};
  const Named not_negative[] = {
      {"heading_lag", heading_lag},  {"deviation_drift", deviation_drift}, {"deviation_turn", deviation_turn},
      {"tilt_turn", tilt_turn},      {"depth_offset", depth_offset},       {"tide_rate", tide_rate},
      {"depth_drift", depth_drift},  {"visual_scale", visual_scale},       {"usbl_shift", usbl_shift},
      {"usbl_turn", usbl_turn},      {"usbl_wander_s", usbl_wander_s},     {"dvl_wander", dvl_wander},
      {"dvl_wander_s", dvl_wander_s}};
  const auto check = [](const Named& named, bool good, const char* range) {
    if (good && std::isfinite(named.second)) return;
    std::ostringstream text;
    text << "sensor noise: " << named.first << " = " << named.second << ", must be " << range;
    throw std::invalid_argument(text.str());
  };
  for (const Named& n : positive) check(n, n.second > 0, "above 0");
  for (const Named& n : not_negative) check(n, n.second >= 0, "0 or more");
}

double headingOf(const SE3& T_odom_cam, const Eigen::Vector3d& forward) {
  const Eigen::Vector3d ahead = T_odom_cam.rotation() * forward;
  return std::atan2(ahead.y(), ahead.x());
}

double LossOfTrack::add(double unlocked_s) {
  if (!(unlocked_s > 0)) {
    lasted_s_ = 0;
    return 0;
  }
  const double before = lasted_s_;
  lasted_s_ += unlocked_s;
  return std::sqrt(lasted_s_ * lasted_s_ - before * before);
}

double stepSigma(double path, const StepQuality& quality, const SensorNoise& noise) {
  const double white =
      noise.dvl_velocity * std::sqrt(std::max(quality.seconds, 1 / noise.dvl_rate) / noise.dvl_rate);
  const double turned = noise.unknown_turn * quality.seconds_untilted;
  const double parts[] = {white,
                          noise.dvl_place * quality.turn,
                          quality.calibration_share * path,
                          noise.heading * path,
                          noise.unknown_velocity * quality.seconds_unlocked,
                          0.5 * turned * path};
  double sum = 0;
  for (const double part : parts) sum += part * part;
  return std::sqrt(sum);
}

double wanderSigma(double path, double seconds, const SensorNoise& noise) {
  return seconds > 0 ? noise.dvl_wander * path * std::sqrt(2 * noise.dvl_wander_s / seconds) : 0;
}

Matrix6d perturbationAt(const Eigen::Vector3d& place) {
  Matrix6d to_place = Matrix6d::Identity();
  to_place.topRightCorner<3, 3>() = -crossMatrix(place);
  return to_place;
}

RelativePose stepFactor(int a, int b, const SE3& T_odom_a, const SE3& T_odom_b,
                        const Eigen::Vector3d& dvl_in_camera, const StepQuality& quality,
                        const SensorNoise& noise) {
  const SE3 between = T_odom_a.inverse() * T_odom_b;
  const double path = (between * dvl_in_camera - dvl_in_camera).norm(),
               horizontal =
                   hypotenuse(stepSigma(path, quality, noise), wanderSigma(path, quality.seconds, noise)),
               by_pressure = kLooseVertical * noise.depth / hypotenuse(noise.depth, quality.pressure_sigma),
               vertical = hypotenuse(by_pressure, horizontal, kTilts * noise.tilt_bias * path);
  const double turned = noise.unknown_turn * quality.seconds_untilted;
  // In nav's axes first: horizontal and vertical.
  const Eigen::Matrix3d R = T_odom_b.matrix3();
  const Eigen::Vector3d position(horizontal, horizontal, vertical);
  Matrix6d information = Matrix6d::Zero();
  information.topLeftCorner<3, 3>() = R.transpose() * position.cwiseAbs2().cwiseInverse().asDiagonal() * R;
  const double turn = hypotenuse(kLooseTurn, turned);
  information.bottomRightCorner<3, 3>() = Eigen::Matrix3d::Identity() / (turn * turn);
  const Matrix6d at_dvl = perturbationAt(dvl_in_camera);
  return {a, b, between, residualInformation(at_dvl.transpose() * information * at_dvl)};
}

RelativePose attitudeFactor(int reference, int camera, const SE3& T_odom_cam, const SensorNoise& noise) {
  return measured(reference, camera, SE3(T_odom_cam.rotation(), Eigen::Vector3d::Zero()), all(kUnknown),
                  {noise.tilt, noise.tilt, noise.heading});
}

RelativePose firstAttitudeReference(int origin, int reference, const CompassOff& off,
                                    const SensorNoise& noise) {
  constexpr double kEnd = 0.25;
  const auto square = [](double x) { return x * x; };
  const double usual = square(noise.deviation), drift = square(kGyroBias * 0.5 * off.seconds),
               here = usual + std::max(0.0, square(off.beyond_mean) - drift),
               carried = usual + drift + square(kEnd * off.beyond_mean), both = here + carried,
               sigma = std::sqrt(std::max(usual, here * carried / both));
  return measured(origin, reference, SE3::fromEuler(0, 0, -off.beyond_mean * here / both, {0, 0, 0}),
                  all(kHeld), {noise.tilt_bias, noise.tilt_bias, sigma});
}

RelativePose attitudeDrift(int before, int after, double seconds, double turn, double extra,
                           const SensorNoise& noise) {
  const double walk = noise.deviation_drift * std::sqrt(std::max(seconds, 0.0));
  const double heading = std::sqrt(kHeld * kHeld + walk * walk +
                                   noise.deviation_turn * noise.deviation_turn * turn + extra * extra);
  const double tilt = hypotenuse(kHeld, noise.tilt_turn * std::sqrt(turn));
  return measured(before, after, SE3(), all(kHeld), {tilt, tilt, heading});
}

RelativePose tiltAbout(int origin, int reference, double turn, const SensorNoise& noise) {
  const double q = std::max(noise.tilt_turn * noise.tilt_turn * turn, kLevel * kLevel),
               s2 = 2 * noise.tilt_bias * noise.tilt_bias;
  // (sqrt(x^2 + 1) - x) / s2 with x = 2 s2 / q, without cancellation
  const double x = 2 * s2 / q, sigma = std::sqrt(s2 * (std::sqrt(x * x + 1) + x));
  return measured(origin, reference, SE3(), all(kUnknown), {sigma, sigma, kUnknown});
}

RelativePose gyroFactor(int a, int b, const SE3& T_odom_a, const SE3& T_odom_b, double beyond, double sigma,
                        double tilt_sigma) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(beyond, Eigen::Vector3d::UnitZ()));
  const Eigen::Quaterniond turned = turn * T_odom_b.rotation();
  const Eigen::Vector3d down = turned.conjugate() * Eigen::Vector3d::UnitZ();
  Matrix6d information = Matrix6d::Identity() / (kUnknown * kUnknown);
  const Eigen::Matrix3d about_down = down * down.transpose();
  information.bottomRightCorner<3, 3>() +=
      about_down / (sigma * sigma) + (Eigen::Matrix3d::Identity() - about_down) / (tilt_sigma * tilt_sigma);
  const SE3 between(T_odom_a.rotation().conjugate() * turned, (T_odom_a.inverse() * T_odom_b).translation());
  return {a, b, between, residualInformation(information)};
}

RelativePose depthFactor(int reference, int camera, const SE3& T_odom_cam, double sigma) {
  return measured(reference, camera, T_odom_cam, {kUnknown, kUnknown, sigma}, all(kUnknown));
}

RelativePose firstTide(int origin, int tide, const SensorNoise& noise) {
  return measured(origin, tide, SE3(), {kHeld, kHeld, hypotenuse(kHeld, noise.depth_offset)},
                  {kLevel, hypotenuse(kLevel, kSlopeOfRate * noise.tide_rate), kLevel});
}

RelativePose tideStep(int before, int after, double seconds, const SensorNoise& noise) {
  const double root = std::sqrt(std::max(seconds, 0.0)), walk = hypotenuse(kHeld, noise.depth_drift * root);
  const SE3 later(Eigen::Quaterniond::Identity(), {seconds / kSlopeOfRate, 0, 0});
  return measured(before, after, later, {kHeld, kHeld, walk},
                  {kLevel, hypotenuse(kLevel, kSlopeOfRate * kTideWalk * noise.tide_rate * root), kLevel});
}

double tideRate(const SE3& T_nav_tide) {
  return (T_nav_tide.rotation() * Eigen::Vector3d::UnitX()).z() / kSlopeOfRate;
}

RelativePose depthAtTide(int tide, int reference) {
  return measured(tide, reference, SE3(), all(kHeld), all(kUnknown));
}

RelativePose levelReference(int origin, int reference) {
  return measured(origin, reference, SE3(), all(kUnknown), all(kLevel));
}

double usblSigma(double sigma, double since_s, const SensorNoise& noise) {
  constexpr double kLeast = 1e-3, kMost = 0.5;
  if (noise.usbl_wander_s <= 0) return sigma;
  const double rho = std::exp(-std::clamp(since_s / noise.usbl_wander_s, kLeast, kMost));
  return sigma * std::sqrt((1 + rho) / (1 - rho));
}

double UsblWander::add(std::int64_t utc_ns, double sigma, const SensorNoise& noise) {
  const double since_s = rt::seconds(utc_ns - last_ns_);
  last_ns_ = utc_ns;
  return usblSigma(sigma, since_s, noise);
}

double usblShift(double sigma, const SensorNoise& noise) {
  return noise.usbl_shift > 0 ? std::max(noise.usbl_shift, sigma) : 0;
}

RelativePose usblFrame(int origin, int usbl, const SE3& T_nav_usbl, double sigma, const SensorNoise& noise) {
  const double shift = hypotenuse(kHeld, usblShift(sigma, noise)), turn = hypotenuse(kHeld, noise.usbl_turn);
  return measured(origin, usbl, T_nav_usbl, {shift, shift, kHeld}, {kHeld, kHeld, turn});
}

RelativePose fixFactor(int origin, int camera, const SE3& T_nav_cam, const SE3& T_odom_cam,
                       const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& fix, double sigma) {
  const Eigen::Vector3d to_antenna =
      T_odom_cam.rotation().conjugate() * (antenna_in_odom - T_odom_cam.translation());
  Eigen::Vector3d place = -(T_nav_cam.rotation() * to_antenna);
  place.head<2>() += fix;
  place.z() = T_nav_cam.translation().z();
  const Eigen::Matrix3d R = T_nav_cam.matrix3();
  const Eigen::Vector3d position(sigma, sigma, kUnknown);
  Matrix6d information = Matrix6d::Identity() / (kUnknown * kUnknown);
  information.topLeftCorner<3, 3>() = R.transpose() * position.cwiseAbs2().cwiseInverse().asDiagonal() * R;
  const Matrix6d at_antenna = perturbationAt(to_antenna);
  return {origin, camera, SE3(T_nav_cam.rotation(), place),
          residualInformation(at_antenna.transpose() * information * at_antenna)};
}

RelativePose usblFixFactor(int usbl, int camera, const SE3& T_nav_usbl, const SE3& T_nav_now,
                           const SE3& T_nav_cam, const SE3& T_odom_cam,
                           const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& fix, double sigma) {
  const SE3 T_seen = T_nav_usbl * T_nav_now.inverse() * T_nav_cam;
  RelativePose factor = fixFactor(usbl, camera, T_seen, T_odom_cam, antenna_in_odom, fix, sigma);
  factor.T_from_to = T_nav_usbl.inverse() * factor.T_from_to;
  return factor;
}

RelativePose linkFactor(int a, int b, const SE3& T_a_b, const Matrix6d& covariance) {
  return {a, b, T_a_b, residualInformation(covariance.inverse())};
}

}  // namespace fathom::slam
