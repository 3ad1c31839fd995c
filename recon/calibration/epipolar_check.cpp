#include "recon/calibration/epipolar_check.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "recon/calibration/robust.hpp"
#include "recon/geometry/order_statistics.hpp"

namespace fathom::calibration {
namespace {

constexpr double kLeastSigma = 1e-3;  // keeps exact matches from dividing by zero [px]

// A match as a line in the right image's normalised plane, of unit normal with v's sign, and the ray there.
struct Constraint {
  Eigen::Vector3d line;
  Eigen::Vector3d ray;
};

Constraint constraintOf(const StereoRig& rig, const RigMatch& match) {
  const RayPair rays = raysOf(rig, match.left, match.right);
  Eigen::Vector3d line = rig.T_right_left.translation().cross(rig.T_right_left.rotation() * rays.left);
  line /= line.head<2>().norm() * (line.y() < 0 ? -1.0 : 1.0);
  return {line, rays.right};
}

// Error when the right camera has turned by `rotation`.
double errorOf(const Constraint& c, double focal, const Eigen::Matrix3d& R_calibrated_now) {
  const Eigen::Vector3d ray = R_calibrated_now * c.ray;
  return focal * c.line.dot(ray) / ray.z();
}

Eigen::Matrix3d turned(const Eigen::Vector3d& rotation) {
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = -rotation;
  return SE3::exp(twist).matrix3();
}

void fitRotation(const std::vector<Constraint>& constraints, double focal, EpipolarCheck& out) {
  constexpr int kIterations = 20;
  constexpr double kStep = 1e-6, kEnough = 1e-8;  // [rad]
  // A rig does not turn farther: holds what the matches leave open.
  constexpr double kPrior = 0.05;  // [rad]
  double sigma = std::max(out.sigma, kLeastSigma);
  Eigen::Matrix3d information;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    std::vector<double> errors;
    for (const Constraint& c : constraints) errors.push_back(errorOf(c, focal, turned(out.rotation)));
    sigma = std::max(madSigma(errors, 0.0), kLeastSigma);
    information = Eigen::Matrix3d::Identity() / (kPrior * kPrior);
    Eigen::Vector3d gradient = out.rotation / (kPrior * kPrior);
    const Eigen::Matrix3d moved[3] = {turned(out.rotation + kStep * Eigen::Vector3d::UnitX()),
                                      turned(out.rotation + kStep * Eigen::Vector3d::UnitY()),
                                      turned(out.rotation + kStep * Eigen::Vector3d::UnitZ())};
    for (std::size_t k = 0; k < constraints.size(); ++k) {
      Eigen::Vector3d slope;
      for (int i = 0; i < 3; ++i) slope(i) = (errorOf(constraints[k], focal, moved[i]) - errors[k]) / kStep;
      const double weight = cauchyWeight(errors[k] / sigma) / (sigma * sigma);
      information += weight * slope * slope.transpose();
      gradient += weight * errors[k] * slope;
    }
    const Eigen::Vector3d step = information.ldlt().solve(-gradient);
    out.rotation += step;
    if (step.norm() < kEnough) break;
  }
  out.sigma_after = sigma;
  out.rotation_sigma = information.inverse().diagonal().cwiseMax(0.0).cwiseSqrt();
}

}  // namespace

double epipolarError(const StereoRig& rig, const RigMatch& match) {
  return errorOf(constraintOf(rig, match), rig.right.fy, Eigen::Matrix3d::Identity());
}

EpipolarCheck checkEpipolar(const StereoRig& rig, const std::vector<RigMatch>& matches) {
  EpipolarCheck out;
  out.cells.resize(static_cast<std::size_t>(kEpipolarColumns) * kEpipolarRows);
  if (matches.empty()) return out;
  std::vector<Constraint> constraints;
  std::vector<std::vector<double>> in_cell(out.cells.size());
  for (const RigMatch& m : matches) {
    constraints.push_back(constraintOf(rig, m));
    out.errors.push_back(errorOf(constraints.back(), rig.right.fy, Eigen::Matrix3d::Identity()));
    const int column =
        std::clamp(static_cast<int>(m.left.x() / rig.left.width * kEpipolarColumns), 0, kEpipolarColumns - 1);
    const int row =
        std::clamp(static_cast<int>(m.left.y() / rig.left.height * kEpipolarRows), 0, kEpipolarRows - 1);
    in_cell[static_cast<std::size_t>(row * kEpipolarColumns + column)].push_back(out.errors.back());
  }
  out.median = median(out.errors);
  out.sigma = madSigma(out.errors, out.median);
  for (std::size_t c = 0; c < in_cell.size(); ++c) {
    out.cells[c] = {median(in_cell[c]), in_cell[c].size()};
    if (in_cell[c].size() < kEnoughInCell || std::abs(out.cells[c].median) <= std::abs(out.worst_cell))
      continue;
    out.worst_cell = out.cells[c].median;
    out.worst_column = static_cast<int>(c) % kEpipolarColumns;
    out.worst_row = static_cast<int>(c) / kEpipolarColumns;
  }
  fitRotation(constraints, rig.right.fy, out);
  return out;
}

}  // namespace fathom::calibration
