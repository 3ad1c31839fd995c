#include "recon/calibration/sensor_checks.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::calibration {
namespace {

constexpr double kLeastSigma = 1e-3;  // floor of sigma, for perfect matches [px]
constexpr double kLeft = 0.5;         // of how far matches were off, at most, when they come to their lines

using Change = RigChange::Vector;

// Epipolar residual of a match after `change` was applied to the rig [px], signed; `rays` are those of the
// rig as it was calibrated.
double errorOf(const StereoRig& rig, const RayPair& rays, const Change& change) {
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = -change.head<3>();
  const RigChange by(change);
  // A lens that is longer, or distorts more than it was thought to, saw the pixel nearer to its axis.
  const auto seenBy = [](const Camera& lens, const Eigen::Vector3d& ray, double longer,
                         double more) -> Eigen::Vector3d {
    const Eigen::Vector2d at = ray.hnormalized();
    const double r2 = at.squaredNorm(), stretch = 1 + r2 * (3 * lens.k1 + 5 * lens.k2 * r2);
    return ((1 - more * r2 / stretch) / std::exp(longer) * at).homogeneous();
  };
  Eigen::Vector3d line = rig.T_right_left.translation().cross(
      rig.T_right_left.rotation() * seenBy(rig.left, rays.left, -0.5 * by.focal, -0.5 * by.radial));
  line /= line.head<2>().norm() * (line.y() < 0 ? -1.0 : 1.0);
  const Eigen::Vector3d ray =
      SE3::exp(twist).matrix3() * seenBy(rig.right, rays.right, 0.5 * by.focal, 0.5 * by.radial);
  return rig.right.fy * line.dot(ray) / ray.z();
}

// Gauss-Newton of our own, because it runs on board, where a replay must give the same bits. The residuals
// are almost linear in the change, so the inner loop over weights keeps the derivatives of the outer one.
void fitChange(const StereoRig& rig, const std::vector<RayPair>& rays, double prior_radial,
               EpipolarCheck& out) {
  constexpr int kLinearised = 3, kWeighted = 8;
  constexpr double kStep = 1e-6, kEnough = 1e-8;  // [rad]
  // Standard deviations of a weak prior, for components that the matches do not determine.
  constexpr double kPriorRotation = 0.05, kPriorLogFocal = 0.02;  // [rad], [1]
  const Change prior = RigChange(Eigen::Vector3d::Constant(kPriorRotation), kPriorLogFocal, prior_radial)
                           .vector()
                           .cwiseAbs2()
                           .cwiseInverse();  // information
  double sigma = std::max(out.sigma, kLeastSigma);
  Change change = Change::Zero();
  RigChange::Matrix information = prior.asDiagonal();
  std::vector<double> errors(rays.size()), left(rays.size());
  std::vector<Change> slopes(rays.size());
  for (int round = 0; round < kLinearised; ++round) {
    for (std::size_t k = 0; k < rays.size(); ++k) {
      errors[k] = errorOf(rig, rays[k], change);
      for (int i = 0; i < RigChange::kParts; ++i)
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
  out.change = RigChange(change);
  out.change_sigma = RigChange(sigmas);
  out.information = information;
}

// Whether a difference in distortion shows beyond chance and beyond the errors that matches share: by how it
// moves lines at the image's corner [px]. Behind flat ports distortion stays as it is (changed()).
bool bendsClearly(const StereoRig& rig, const EpipolarCheck& check) {
  constexpr double kLeast = 0.25, kSigmas = 6;
  if (rig.left.port || rig.right.port) return false;
  const Camera& lens = rig.left;
  const Eigen::Vector2d corner(0.5 * lens.width / lens.fx, 0.5 * lens.height / lens.fy);
  const double radial = std::abs(check.change.radial);
  return lens.fy * corner.y() * corner.squaredNorm() * radial > kLeast &&
         radial > kSigmas * check.change_sigma.radial;
}

constexpr std::size_t kFewest = 8;      // samples of ranges, or steps of motion
constexpr std::size_t kBlocks = 10;     // at most
constexpr double kLeastScatter = 1e-4;  // [m]

using Samples = std::vector<RangeSample>;

double ratioOf(const Samples& samples) {
  std::vector<double> ratios;
  for (const RangeSample& s : samples) ratios.push_back(s.stereo / s.dvl);
  return median(std::move(ratios));
}

// (offset, scale) of the robust line. The DVL's ranges scatter: its four beams sample a rough seafloor,
// stereo averages it. Therefore the DVL's range is regressed on stereo's, and the line inverted; in the
// opposite direction noise of the regressor would bias its slope towards zero.
Eigen::Vector2d lineOf(const Samples& samples) {
  constexpr int kIterations = 30;
  Eigen::Vector2d line(0, 1 / ratioOf(samples));  // dvl = line(0) + line(1) * stereo
  for (int i = 0; i < kIterations; ++i) {
    std::vector<double> residuals;
    for (const RangeSample& s : samples) residuals.push_back(s.dvl - line(0) - line(1) * s.stereo);
    const double sigma = std::max(madSigma(residuals, 0.0), kLeastScatter);
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const Eigen::Vector2d row(1, samples[k].stereo);
      const double weight = cauchyWeight(residuals[k] / sigma);
      normal += weight * row * row.transpose();
      right += weight * samples[k].dvl * row;
    }
    line = normal.ldlt().solve(right);
  }
  return {-line(0) / line(1), 1 / line(1)};
}

// The samples in consecutive blocks.
std::vector<Samples> blocksOf(const Samples& samples) {
  const std::size_t count = std::clamp<std::size_t>(samples.size() / 3, 2, kBlocks);
  std::vector<Samples> out(count);
  for (std::size_t k = 0; k < samples.size(); ++k) out[k * count / samples.size()].push_back(samples[k]);
  return out;
}

// Standard deviation of an estimate by leaving out one block after another (jackknife).
Eigen::VectorXd jackknife(const std::vector<Samples>& blocks, const auto& estimate) {
  std::vector<Eigen::VectorXd> without;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    Samples rest;
    for (std::size_t other = 0; other < blocks.size(); ++other)
      if (other != b) rest.insert(rest.end(), blocks[other].begin(), blocks[other].end());
    without.push_back(estimate(rest));
  }
  const auto n = static_cast<double>(without.size());
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(without[0].size()), squares = mean;
  for (const auto& w : without) mean += w / n;
  for (const auto& w : without) squares += (w - mean).cwiseAbs2();
  return ((n - 1) / n * squares).cwiseSqrt();
}

constexpr double kLeastRotation = 1e-6, kLeastMiddle = 1e-6;  // floors of the residuals' sigmas [rad], [m]
// Standard deviation of the weak prior of each axis; an axis whose sigma then exceeds half of it is reported
// as unobservable.
constexpr double kPriorSigma = 0.15;  // [rad]

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

// Gauss-Newton by hand: the scatter that scales the weights is estimated again in every step, which a loss of
// Ceres does not do.
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
    information = Eigen::Matrix3d::Identity() / (kPriorSigma * kPriorSigma);
    Eigen::Vector3d gradient = out.rotation / (kPriorSigma * kPriorSigma);
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
    if (out.sigma(i) > 0.5 * kPriorSigma) out.sigma(i) = std::numeric_limits<double>::infinity();
  return out;
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
  constexpr double kPriorRadial = 0.02, kAsCalibrated = 1e-9;
  fitChange(rig, rays, kPriorRadial, out);
  if (!bendsClearly(rig, out)) fitChange(rig, rays, kAsCalibrated, out);
  return out;
}

bool measuresRig(const EpipolarCheck& check, std::size_t fewest) {
  return check.errors.size() >= fewest && check.sigma_after < std::max(kMostMedian, kLeft * check.worst());
}

bool explainsMove(const EpipolarCheck& check) {
  return measuresRig(check) && hasMoved(check) && check.sigma_after < kLeft * check.worst();
}

bool hasMoved(const EpipolarCheck& check) {
  return std::abs(check.median) > kMostMedian || std::abs(check.worst_cell) > kMostCell;
}

std::string describeChange(const RigChange& change) {
  const Eigen::Vector3d degrees = change.rotation.unaryExpr(&radiansToDegrees);
  return "the right camera as turned by pitch " + decimals(degrees.x(), 3) + ", yaw " +
         decimals(degrees.y(), 3) + ", roll " + decimals(degrees.z(), 3) + " deg, its focal lengths as " +
         decimals(100 * change.focal, 2) + " % longer and its distortion (k1) as " +
         decimals(change.radial, 4) + " more against the left one's";
}

StereoRig changed(const StereoRig& rig, const RigChange& change) {
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = change.rotation;
  StereoRig out = rig;
  out.T_right_left = SE3::exp(twist) * rig.T_right_left;
  if (rig.left.port || rig.right.port) return out;
  const double half = std::exp(0.5 * change.focal);
  out.left.fx /= half, out.left.fy /= half;
  out.right.fx *= half, out.right.fy *= half;
  out.left.k1 -= 0.5 * change.radial, out.right.k1 += 0.5 * change.radial;
  return out;
}

RangeCheck checkRanges(const std::vector<RangeSample>& samples) {
  RangeCheck out;
  out.samples = samples.size();
  if (samples.size() < kFewest) return out;
  std::vector<double> ranges, off;
  for (const RangeSample& s : samples) ranges.push_back(s.dvl);
  std::sort(ranges.begin(), ranges.end());
  out.shortest = ranges[ranges.size() / 20];
  out.longest = ranges[ranges.size() - 1 - ranges.size() / 20];
  out.ratio = ratioOf(samples);
  for (const RangeSample& s : samples) off.push_back(s.stereo / s.dvl - out.ratio);
  out.scatter = madSigma(off, 0.0);
  const std::vector<Samples> blocks = blocksOf(samples);
  std::vector<double> of_blocks;
  for (const Samples& block : blocks) of_blocks.push_back(ratioOf(block));
  double squares = 0;
  for (const double r : of_blocks) squares += (r - out.ratio) * (r - out.ratio);
  const auto n = static_cast<double>(blocks.size());
  out.ratio_sigma = std::sqrt(squares / (n * (n - 1)));

  constexpr double kSpan = 1.25;  // of longest over shortest; below, scale and offset cannot be separated
  out.line_known = out.longest > kSpan * out.shortest;
  if (!out.line_known) return out;
  const Eigen::Vector2d line = lineOf(samples);
  const Eigen::VectorXd sigma =
      jackknife(blocks, [](const Samples& s) { return Eigen::VectorXd(lineOf(s)); });
  out.offset = line(0), out.scale = line(1);
  out.offset_sigma = sigma(0), out.scale_sigma = sigma(1);
  return out;
}

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

  // Ratio of the visual displacement to the one expected from the DVL.
  const Eigen::Matrix3d X = turn(out.both.rotation) * assumed.matrix3();
  const Eigen::Vector3d& place = assumed.translation();
  constexpr double kLeastMove = 0.05;  // shorter steps determine no scale [m]
  std::vector<double> ratios;
  for (const MotionStep& s : steps) {
    const Eigen::Vector3d before = X * s.middle0 + place, expected = s.T_b1_b0 * before;
    const Eigen::Vector3d moved = X * s.middle1 + place - before;
    out.turned += logOf(s.T_b1_b0.matrix3()).norm();
    out.travelled += s.T_b1_b0.translation().norm();
    if ((expected - before).norm() > kLeastMove)
      ratios.push_back(moved.dot(expected - before) / (expected - before).squaredNorm());
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
