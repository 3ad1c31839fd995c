#include "recon/calibration/epipolar_check.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::calibration {
namespace {

constexpr double kLeastSigma = 1e-3;  // keeps exact matches from dividing by zero [px]

using Change = Eigen::Vector4d;  // rotation of the right camera [rad], its focal lengths' logarithm

// Signed distance of a match's right ray from the epipolar line of its left one when the rig has changed
// [px]. Rays of the rig as it was calibrated.
double errorOf(const StereoRig& rig, const RayPair& rays, const Change& change) {
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = -change.head<3>();
  const double half = std::exp(0.5 * change.w());
  const auto longer = [](const Eigen::Vector3d& ray, double factor) -> Eigen::Vector3d {
    return {ray.x() / factor, ray.y() / factor, ray.z()};
  };
  Eigen::Vector3d line =
      rig.T_right_left.translation().cross(rig.T_right_left.rotation() * longer(rays.left, 1 / half));
  line /= line.head<2>().norm() * (line.y() < 0 ? -1.0 : 1.0);
  const Eigen::Vector3d ray = SE3::exp(twist).matrix3() * longer(rays.right, half);
  return rig.right.fy * line.dot(ray) / ray.z();
}

// Gauss-Newton by hand, because it runs on board, where replays keep its bits. Two loops: errors are so
// nearly linear in a change that the inner one, of weights, needs no new derivatives.
void fitChange(const StereoRig& rig, const std::vector<RayPair>& rays, EpipolarCheck& out) {
  constexpr int kLinearised = 3, kWeighted = 8;
  constexpr double kStep = 1e-6, kEnough = 1e-8;  // [rad]
  // Standard deviations of a weak prior, for components that the matches do not determine.
  constexpr double kTurned = 0.05, kLonger = 0.02;
  const Change prior =
      Change(1 / kTurned, 1 / kTurned, 1 / kTurned, 1 / kLonger).array().square();  // information
  double sigma = std::max(out.sigma, kLeastSigma);
  Change change = Change::Zero();
  Eigen::Matrix4d information = prior.asDiagonal();
  std::vector<double> errors(rays.size()), left(rays.size());
  std::vector<Change> slopes(rays.size());
  for (int round = 0; round < kLinearised; ++round) {
    for (std::size_t k = 0; k < rays.size(); ++k) {
      errors[k] = errorOf(rig, rays[k], change);
      for (int i = 0; i < 4; ++i)
        slopes[k](i) = (errorOf(rig, rays[k], change + kStep * Change::Unit(i)) - errors[k]) / kStep;
    }
    const Change start = change;
    for (int weighting = 0; weighting < kWeighted; ++weighting) {
      const Change moved = change - start;
      for (std::size_t k = 0; k < rays.size(); ++k) left[k] = errors[k] + slopes[k].dot(moved);
      sigma = std::max(madSigma(left, 0.0), kLeastSigma);
      information = prior.asDiagonal();
      Change gradient = prior.cwiseProduct(change);
      for (std::size_t k = 0; k < rays.size(); ++k) {
        const double weight = cauchyWeight(left[k] / sigma) / (sigma * sigma);
        information += weight * slopes[k] * slopes[k].transpose();
        gradient += weight * left[k] * slopes[k];
      }
      const Change step = information.ldlt().solve(-gradient);
      change += step;
      if (step.norm() < kEnough) break;
    }
    if ((change - start).norm() < kEnough) break;
  }
  const Change sigmas = information.inverse().diagonal().cwiseMax(0.0).cwiseSqrt();
  out.sigma_after = sigma;
  out.rotation = change.head<3>();
  out.rotation_sigma = sigmas.head<3>();
  out.focal = change.w();
  out.focal_sigma = sigmas.w();
  out.information = information;
}

}  // namespace

double cauchyWeight(double sigmas) {
  constexpr double kTuning = 2.385;
  const double x = sigmas / kTuning;
  return 1.0 / (1.0 + x * x);
}

double epipolarError(const StereoRig& rig, const RigMatch& match) {
  return errorOf(rig, raysOf(rig, match.left, match.right), Change::Zero());
}

EpipolarCheck checkEpipolar(const StereoRig& rig, const std::vector<RigMatch>& matches) {
  EpipolarCheck out;
  out.cells.resize(static_cast<std::size_t>(kEpipolarColumns) * kEpipolarRows);
  if (matches.empty()) return out;
  std::vector<RayPair> rays;
  std::vector<std::vector<double>> in_cell(out.cells.size());
  for (const RigMatch& m : matches) {
    rays.push_back(raysOf(rig, m.left, m.right));
    out.errors.push_back(errorOf(rig, rays.back(), Change::Zero()));
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
  fitChange(rig, rays, out);
  return out;
}

double EpipolarCheck::worst() const {
  return std::max(std::abs(median), std::abs(worst_cell));
}

bool measuresRig(const EpipolarCheck& check, std::size_t fewest) {
  return check.errors.size() >= fewest && check.sigma_after < kMostMedian;
}

bool explainsMove(const EpipolarCheck& check) {
  return measuresRig(check) && hasMoved(check) && check.sigma_after < 0.5 * check.worst();
}

bool hasMoved(const EpipolarCheck& check) {
  return std::abs(check.median) > kMostMedian || std::abs(check.worst_cell) > kMostCell;
}

std::string describeChange(const Eigen::Vector3d& rotation, double focal) {
  const Eigen::Vector3d degrees = rotation.unaryExpr(&radiansToDegrees);
  return "the right camera as turned by pitch " + decimals(degrees.x(), 3) + ", yaw " +
         decimals(degrees.y(), 3) + ", roll " + decimals(degrees.z(), 3) + " deg, its focal lengths as " +
         decimals(100 * focal, 2) + " % longer against the left one's";
}

StereoRig changed(const StereoRig& rig, const Eigen::Vector3d& rotation, double focal) {
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = rotation;
  StereoRig out = rig;
  out.T_right_left = SE3::exp(twist) * rig.T_right_left;
  if (rig.left.port || rig.right.port) return out;
  const double half = std::exp(0.5 * focal);
  out.left.fx /= half, out.left.fy /= half;
  out.right.fx *= half, out.right.fy *= half;
  return out;
}

}  // namespace fathom::calibration
