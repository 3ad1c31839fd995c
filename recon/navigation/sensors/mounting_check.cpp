#include "recon/navigation/sensors/mounting_check.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::slam {
namespace {

constexpr int kUnknowns = 5;                                 // turn, scale, offset
constexpr int kMountingRounds = 8;                           // of weights
constexpr double kTurn = 0.1, kScale = 0.05, kOffset = 0.5;  // as known before [rad], [1], [s]
// Change of the rate of turn over a step, in standard deviations of its noise, below which the step is not
// used for the offset: the noise of rates would hide it.
constexpr double kTurning = 5;
// Of the offset: differences over two steps see rates that change faster as smaller than they are.
constexpr double kSmoothed = 0.1;

using Row = Eigen::Matrix<double, 6, kUnknowns>;
using Vector5d = Eigen::Matrix<double, kUnknowns, 1>;
using Matrix5d = Eigen::Matrix<double, kUnknowns, kUnknowns>;

struct Step {
  Row by;
  Vector6d error;
  Matrix6d information;
};

double stepSeconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

bool isMeasured(const KeyframeInput& frame) {
  return !frame.attitude_held && !frame.depth_held && !frame.compass_jumped && frame.untilted_s == 0;
}

// Of frame k, by those beside it.
Vector6d twistAt(const std::vector<KeyframeInput>& frames, std::size_t k) {
  const KeyframeInput &before = frames[k - 1], &after = frames[k + 1];
  return (before.T_odom_cam.inverse() * after.T_odom_cam).log() / stepSeconds(after.utc_ns - before.utc_ns);
}

// Of dead reckoning over the step, in the axes of b.
Matrix6d reckoningSpread(const KeyframeInput& a, const KeyframeInput& b, double turn,
                         const SensorNoise& noise) {
  StepQuality quality;
  quality.seconds = stepSeconds(b.utc_ns - a.utc_ns);
  quality.seconds_unlocked = b.unlocked_s;
  const double path = (b.T_odom_cam.translation() - a.T_odom_cam.translation()).norm();
  const double step = stepSigma(path, quality, noise);
  const double tilt = 2 * noise.tilt * noise.tilt + noise.tilt_turn * noise.tilt_turn * turn;
  const double heading =
      2 * noise.heading * noise.heading + noise.deviation_turn * noise.deviation_turn * turn;
  const Eigen::Matrix3d R = b.T_odom_cam.matrix3();
  const double depth = hypotenuse(noise.depth, b.pressure_sigma);
  const Eigen::Vector3d place(step * step, step * step, 2 * depth * depth);
  Matrix6d spread = Matrix6d::Zero();
  spread.topLeftCorner<3, 3>() = R.transpose() * place.asDiagonal() * R;
  spread.bottomRightCorner<3, 3>() = R.transpose() * Eigen::Vector3d(tilt, tilt, heading).asDiagonal() * R;
  return spread;
}

Step stepOf(const std::vector<KeyframeInput>& frames, const NavigationLink& link, const SensorNoise& noise) {
  const KeyframeInput &a = frames[link.a], &b = frames[link.b];
  const SE3 path = a.T_odom_cam.inverse() * b.T_odom_cam;
  const Eigen::Matrix3d back = path.matrix3().transpose();
  const Eigen::Vector3d down = a.T_odom_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d level = path.translation() - down.dot(path.translation()) * down;
  Step step;
  step.by.topLeftCorner<3, 3>() = back * crossMatrix(path.translation());
  step.by.bottomLeftCorner<3, 3>() = Eigen::Matrix3d::Identity() - back;
  step.by.col(3) << back * level, Eigen::Vector3d::Zero();
  const Vector6d change = twistAt(frames, link.b) - adjoint(path.inverse()) * twistAt(frames, link.a);
  const double rate = noise.heading / stepSeconds(b.utc_ns - a.utc_ns);
  if (change.tail<3>().norm() > kTurning * rate)
    step.by.col(4) = change;
  else
    step.by.col(4).setZero();
  step.error = (path.inverse() * link.T_a_b).log();
  const double turn = std::abs(down.dot(path.log().tail<3>()));
  step.information = (link.covariance + reckoningSpread(a, b, turn, noise)).inverse();
  return step;
}

}  // namespace

Mounting mountingOf(const std::vector<KeyframeInput>& frames, std::span<const NavigationLink> links,
                    const SensorNoise& noise) {
  std::vector<Step> steps;
  for (const NavigationLink& link : links) {
    if (!link.ofChain() || link.a == 0 || link.b + 1 >= frames.size()) continue;
    const auto around = std::span(frames).subspan(link.a - 1, 4);
    if (std::all_of(around.begin(), around.end(), isMeasured)) steps.push_back(stepOf(frames, link, noise));
  }
  Vector5d before;
  before << Eigen::Vector3d::Constant(kTurn), kScale, kOffset;
  Vector5d x = Vector5d::Zero(), sigma = before;
  for (int round = 0; round < kMountingRounds && !steps.empty(); ++round) {
    Matrix5d square = before.cwiseAbs2().cwiseInverse().asDiagonal();
    Vector5d right = Vector5d::Zero();
    for (const Step& step : steps) {
      const Vector6d left = step.error - step.by * x;
      const double weight = cauchyWeight(left.dot(step.information * left), kLinkFree);
      const Eigen::Matrix<double, kUnknowns, 6> weighted = weight * step.by.transpose() * step.information;
      square += weighted * step.by;
      right += weighted * step.error;
    }
    const Eigen::LLT<Matrix5d> factor(square);
    x = factor.solve(right);
    sigma = factor.solve(Matrix5d::Identity()).diagonal().cwiseSqrt();
  }
  const auto misfitOf = [&](const Vector5d& y) {
    double sum = 0;
    for (const Step& step : steps) {
      const Vector6d left = step.error - step.by * y;
      sum += std::log1p(left.dot(step.information * left) / kLinkFree);
    }
    return steps.empty() ? 0 : sum / static_cast<double>(steps.size());
  };
  Vector5d unshifted = x;
  unshifted(4) = 0;
  return {x.head<3>(),
          sigma.head<3>(),
          x(3),
          sigma(3),
          x(4),
          hypotenuse(sigma(4), kSmoothed * x(4)),
          static_cast<int>(steps.size()),
          misfitOf(x),
          misfitOf(unshifted)};
}

PathScale pathScaleOf(const std::vector<KeyframeInput>& frames, std::span<const NavigationLink> links,
                      const Eigen::Vector3d& dvl_in_camera, const SensorNoise& noise) {
  constexpr double kHuber = 1.5;      // standard deviations
  constexpr double kLeastPath = 0.1;  // [m]
  constexpr int kRounds = 10;
  struct One {
    double longer, sigma;
  };
  std::vector<One> steps;
  for (const NavigationLink& link : links) {
    const KeyframeInput &a = frames[link.a], &b = frames[link.b];
    if (!link.ofChain() || !link.kept || !isMeasured(a) || !isMeasured(b) || b.unlocked_s > 0) continue;
    const SE3 by_dvl = a.T_odom_cam.inverse() * b.T_odom_cam;
    const Eigen::Vector3d &camera = link.T_a_b.translation(),
                          arm = link.T_a_b.rotation() * dvl_in_camera - dvl_in_camera, seen = camera + arm;
    const double path = (by_dvl * dvl_in_camera - dvl_in_camera).norm();
    if (path < kLeastPath || seen.norm() < kLeastPath) continue;
    // The camera's path times s, with the arm that turns, is as long as the DVL's.
    const double forward = camera.dot(arm), square = camera.squaredNorm(),
                 root2 = forward * forward + square * (path * path - arm.squaredNorm());
    if (root2 <= 0) continue;
    const double root = std::sqrt(root2), s = (root - forward) / square;
    if (s <= 0) continue;
    const Matrix6d at_dvl = perturbationAt(dvl_in_camera);
    const Eigen::Matrix3d spread = (at_dvl * link.covariance * at_dvl.transpose()).topLeftCorner<3, 3>();
    const Eigen::Vector3d along_in_b = link.T_a_b.rotation().conjugate() * seen.normalized();
    const double turn = by_dvl.rotation().angularDistance(Eigen::Quaterniond::Identity()),
                 white = noise.dvl_velocity *
                         std::sqrt(std::max(stepSeconds(b.utc_ns - a.utc_ns), 1 / noise.dvl_rate) /
                                   noise.dvl_rate);
    const double sigma = hypotenuse(std::sqrt(std::max(0.0, along_in_b.dot(spread * along_in_b))), white,
                                    noise.dvl_place * turn);
    steps.push_back({-std::log(s), sigma * path / (s * root)});  // d log s = path d path / (s root)
  }
  PathScale out;
  constexpr std::size_t kFewest = 3;  // fewer say nothing of their own errors
  if (steps.size() < kFewest) return out;
  out.steps = static_cast<int>(steps.size());
  std::vector<double> values;
  for (const One& step : steps) values.push_back(step.longer);
  out.longer = median(std::move(values));
  double scatter = 1;
  for (int round = 0; round < kRounds; ++round) {
    double sum = 0, weights = 0, squares = 0;
    for (const One& step : steps) {
      const double sigma = scatter * step.sigma, off = std::abs(step.longer - out.longer) / sigma,
                   weight = std::min(1.0, kHuber / std::max(off, 1e-9)) / (sigma * sigma);
      sum += weight * step.longer;
      weights += weight;
      squares += std::min(off, kHuber) * std::min(off, kHuber);
    }
    constexpr double kOfClipped = 0.778;  // mean of a normal variable's square, clipped at kHuber
    out.longer = sum / weights;
    out.sigma = 1 / std::sqrt(weights);
    scatter = std::max(1.0, scatter * std::sqrt(squares / (kOfClipped * static_cast<double>(steps.size()))));
  }
  return out;
}

}  // namespace fathom::slam
