#include "recon/calibration/mount_alignment.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "recon/calibration/robust.hpp"
#include "recon/geometry/order_statistics.hpp"

namespace fathom::calibration {
namespace {

constexpr std::size_t kFewest = 8;                            // steps
constexpr double kLeastRotation = 1e-6, kLeastMiddle = 1e-6;  // of the scatter [rad], [m]
// An axis known no better than this is said to be open; so weak a prior holds it.
constexpr double kOpen = 0.15;  // [rad]

enum class Uses { kRotations, kMiddles, kBoth };

Eigen::Matrix3d turn(const Eigen::Vector3d& rotation) {
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = rotation;
  return SE3::exp(twist).matrix3();
}

Eigen::Vector3d logOf(const Eigen::Matrix3d& rotation) {
  return SE3(rotation, Eigen::Vector3d::Zero()).log().tail<3>();
}

struct Residuals {
  Eigen::Vector3d rotation, middle;
};

Residuals residualsOf(const MotionStep& step, const Eigen::Matrix3d& X, const Eigen::Vector3d& place) {
  const Eigen::Matrix3d body = step.T_b1_b0.matrix3();
  return {logOf(X * step.R_c1_c0.toRotationMatrix() * X.transpose() * body.transpose()),
          X * step.middle1 + place - step.T_b1_b0 * (X * step.middle0 + place)};
}

struct Scatter {
  double rotation = 0, middle = 0;
};

Scatter scatterOf(const std::vector<MotionStep>& steps, const Eigen::Matrix3d& X,
                  const Eigen::Vector3d& place) {
  std::vector<double> rotations, middles;
  for (const MotionStep& s : steps) {
    const Residuals r = residualsOf(s, X, place);
    for (int i = 0; i < 3; ++i) rotations.push_back(r.rotation(i)), middles.push_back(r.middle(i));
  }
  return {std::max(madSigma(std::move(rotations), 0.0), kLeastRotation),
          std::max(madSigma(std::move(middles), 0.0), kLeastMiddle)};
}

MountEstimate estimate(const std::vector<MotionStep>& steps, const SE3& assumed, Uses uses,
                       Scatter& scatter) {
  constexpr int kIterations = 30;
  constexpr double kStep = 1e-6, kEnough = 1e-9;  // [rad]
  MountEstimate out;
  const Eigen::Matrix3d start = assumed.matrix3();
  const Eigen::Vector3d& place = assumed.translation();
  Eigen::Matrix3d information;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const Eigen::Matrix3d X = turn(out.rotation) * start;
    scatter = scatterOf(steps, X, place);
    information = Eigen::Matrix3d::Identity() / (kOpen * kOpen);
    Eigen::Vector3d gradient = out.rotation / (kOpen * kOpen);
    for (const MotionStep& s : steps) {
      const Residuals r = residualsOf(s, X, place);
      Eigen::Matrix3d by_rotation, by_middle;
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector3d moved = out.rotation + kStep * Eigen::Vector3d::Unit(i);
        const Residuals there = residualsOf(s, turn(moved) * start, place);
        by_rotation.col(i) = (there.rotation - r.rotation) / kStep;
        by_middle.col(i) = (there.middle - r.middle) / kStep;
      }
      const auto add = [&](const Eigen::Matrix3d& jacobian, const Eigen::Vector3d& residual, double sigma) {
        const double weight = cauchyWeight(residual.norm() / (std::sqrt(3.0) * sigma)) / (sigma * sigma);
        information += weight * jacobian.transpose() * jacobian;
        gradient += weight * jacobian.transpose() * residual;
      };
      if (uses != Uses::kMiddles) add(by_rotation, r.rotation, scatter.rotation);
      if (uses != Uses::kRotations) add(by_middle, r.middle, scatter.middle);
    }
    const Eigen::Vector3d step = information.ldlt().solve(-gradient);
    out.rotation += step;
    if (step.norm() < kEnough) break;
  }
  out.known = true;
  out.sigma = information.inverse().diagonal().cwiseMax(0.0).cwiseSqrt();
  for (int i = 0; i < 3; ++i)
    if (out.sigma(i) > 0.5 * kOpen) out.sigma(i) = std::numeric_limits<double>::infinity();
  return out;
}

}  // namespace

MountAlignment alignMount(const std::vector<MotionStep>& steps, const SE3& assumed) {
  MountAlignment out;
  out.steps = steps.size();
  if (steps.size() < kFewest) return out;
  Scatter scatter;
  out.compass = estimate(steps, assumed, Uses::kRotations, scatter);
  out.dvl = estimate(steps, assumed, Uses::kMiddles, scatter);
  out.both = estimate(steps, assumed, Uses::kBoth, scatter);
  out.rotation_scatter = scatter.rotation;
  out.middle_scatter = scatter.middle;

  // How far what it saw has moved through the image, against how far it should have.
  const Eigen::Matrix3d X = turn(out.both.rotation) * assumed.matrix3();
  const Eigen::Vector3d& place = assumed.translation();
  constexpr double kLeastMove = 0.05;  // a shorter step says little about scale [m]
  std::vector<double> ratios;
  for (const MotionStep& s : steps) {
    const Eigen::Vector3d before = X * s.middle0 + place, should = s.T_b1_b0 * before;
    const Eigen::Vector3d moved = X * s.middle1 + place - before;
    out.turned += logOf(s.T_b1_b0.matrix3()).norm();
    out.travelled += s.T_b1_b0.translation().norm();
    if ((should - before).norm() > kLeastMove)
      ratios.push_back(moved.dot(should - before) / (should - before).squaredNorm());
  }
  if (!ratios.empty()) {
    constexpr double kMedian = 1.2533;  // standard error of a median over that of a mean
    out.speed_ratio = median(ratios);
    out.speed_ratio_sigma =
        kMedian * madSigma(ratios, out.speed_ratio) / std::sqrt(static_cast<double>(ratios.size()));
  }
  return out;
}

}  // namespace fathom::calibration
