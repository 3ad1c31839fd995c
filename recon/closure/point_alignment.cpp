#include "recon/closure/point_alignment.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>

#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::closure {
namespace {

constexpr double kInlierGate = 7.815;  // 95 % of chi-square with 3 degrees of freedom
// Mean of chi-square with 3 degrees of freedom below that gate: 3 F5(7.815) / F3(7.815).
constexpr double kInlierMean = 2.631;

template <int kSize>
struct NormalEquations {
  using Vector = Eigen::Matrix<double, kSize, 1>;
  using Matrix = Eigen::Matrix<double, kSize, kSize>;
  Matrix h = Matrix::Zero();
  Vector b = Vector::Zero();
  Eigen::LDLT<Matrix> factor;  // of h, by solve()

  void add(const Eigen::Matrix<double, 3, kSize>& j, const Eigen::Vector3d& e,
           const Eigen::Matrix3d& information) {
    h += j.transpose() * information * j;
    b -= j.transpose() * information * e;
  }
  [[nodiscard]] bool solve(Vector& step) {
    factor.compute(h);
    if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 0)) return false;
    step = factor.solve(b);
    return step.allFinite();
  }
};

Eigen::Matrix3d informationOf(const PointPair& p, const Eigen::Matrix3d& rotation) {
  return (p.covariance_a + rotation * p.covariance_b * rotation.transpose()).inverse();
}

Eigen::Matrix<double, 3, 6> byPose(const PointPair& p, const Eigen::Matrix3d& rotation) {
  Eigen::Matrix<double, 3, 6> j;
  j << -rotation, rotation * crossMatrix(p.b);
  return j;
}

// Whether the sides between pairs i and j have equal lengths, within four standard deviations.
bool sameSide(const PointPair& i, const PointPair& j) {
  const Eigen::Vector3d a = i.a - j.a, b = i.b - j.b;
  const double la = a.norm(), lb = b.norm();
  constexpr double kMinSide = 0.02;  // shorter sides give no direction [m]
  if (la < kMinSide || lb < kMinSide) return false;
  const double variance = (a.dot((i.covariance_a + j.covariance_a) * a)) / (la * la) +
                          (b.dot((i.covariance_b + j.covariance_b) * b)) / (lb * lb);
  return (la - lb) * (la - lb) < 16 * variance;
}

// A disparity error d moves a point along its ray, by z d / (f b) of its distance: by a pixel [m].
Eigen::Vector3d byDisparity(double focal_length_px, double baseline, const Eigen::Vector3d& point) {
  return -point.z() / (focal_length_px * baseline) * point;
}

}  // namespace

Eigen::RowVector4d unevenDisparity(const SharedErrors& errors, const Eigen::Vector2d& tangent) {
  Eigen::RowVector4d disparity;
  disparity << errors.disparity_slope * tangent.transpose(),
      errors.disparity_curve * tangent.cwiseAbs2().transpose();
  return disparity;
}

SharedJacobian sharedJacobian(const SharedErrors& errors, double focal_length_px, double baseline,
                              const Eigen::Vector3d& point) {
  const double z = point.z(), x = point.x() / z, y = point.y() / z;
  const Eigen::Vector3d by_disparity = byDisparity(focal_length_px, baseline, point);
  SharedJacobian j;
  j.col(0) = Eigen::Vector3d(errors.place * z, 0, 0);
  j.col(1) = Eigen::Vector3d(0, errors.place * z, 0);
  j.col(2) = errors.place_slope * z * Eigen::Vector3d(x, y, 0);
  j.col(3) = errors.disparity * by_disparity;
  j.rightCols<2>() = by_disparity * unevenDisparity(errors, {x, y}).head<2>();
  return j;
}

CommonJacobian commonJacobian(const SharedErrors& errors, double focal_length_px, double baseline,
                              const Eigen::Vector3d& point) {
  CommonJacobian j;
  j.leftCols<kSharedErrors>() = sharedJacobian(errors, focal_length_px, baseline, point);
  j.rightCols<2>() =
      byDisparity(focal_length_px, baseline, point) * unevenDisparity(errors, point.hnormalized()).tail<2>();
  return j;
}

PoseByCommonErrors poseBySharedErrors(const SharedErrors& errors, double focal_length_px, double baseline,
                                      const Eigen::Vector2d& half_view, double range, const SE3& T_a_b) {
  constexpr int kCells = 8;        // of a grid over the image, along x and y
  constexpr double kAlongRay = 9;  // variance of a point along the ray over that across
  const Eigen::Matrix3d R = T_a_b.matrix3();
  const Eigen::Matrix3d information = Eigen::Vector3d(1, 1, 1 / kAlongRay).asDiagonal();
  Matrix6d h = Matrix6d::Zero();
  PoseByCommonErrors pull = PoseByCommonErrors::Zero();
  int seen = 0;
  for (int row = 1; row < 2 * kCells; row += 2)
    for (int column = 1; column < 2 * kCells; column += 2) {
      const Eigen::Vector2d tangent =
          half_view.cwiseProduct(Eigen::Vector2d(column, row) / kCells - Eigen::Vector2d::Ones());
      const Eigen::Vector3d b = range * tangent.homogeneous(), a = T_a_b * b;
      if (!(a.z() > 0) || ((a.hnormalized().cwiseAbs() - half_view).array() > 0).any()) continue;
      ++seen;
      Eigen::Matrix<double, 3, 6> by_pose;
      by_pose << R, -R * crossMatrix(b);
      const CommonJacobian by_shared = commonJacobian(errors, focal_length_px, baseline, a) -
                                       R * commonJacobian(errors, focal_length_px, baseline, b);
      h += by_pose.transpose() * information * by_pose;
      pull += by_pose.transpose() * information * by_shared;
    }
  constexpr int kLeastSeen = 6;
  if (seen < kLeastSeen) return PoseByCommonErrors::Zero();
  return h.ldlt().solve(pull);
}

std::optional<SE3> absoluteOrientation(const std::vector<PointPair>& pairs, const std::vector<int>& chosen) {
  if (chosen.size() < 3) return std::nullopt;
  Eigen::Vector3d mean_a = Eigen::Vector3d::Zero(), mean_b = mean_a;
  for (const int k : chosen) {
    mean_a += pairs[static_cast<std::size_t>(k)].a / static_cast<double>(chosen.size());
    mean_b += pairs[static_cast<std::size_t>(k)].b / static_cast<double>(chosen.size());
  }
  Eigen::Matrix3d s = Eigen::Matrix3d::Zero(), spread = s;
  for (const int k : chosen) {
    const PointPair& p = pairs[static_cast<std::size_t>(k)];
    s += (p.b - mean_b) * (p.a - mean_a).transpose();
    spread += (p.b - mean_b) * (p.b - mean_b).transpose();
  }
  const Eigen::Vector3d axes = symmetricEigenvalues(spread);
  constexpr double kOnALine = 1e-3;  // square of width over length
  if (!(axes(1) > kOnALine * axes(2))) return std::nullopt;
  Eigen::Matrix4d n;
  n << s.trace(), s(1, 2) - s(2, 1), s(2, 0) - s(0, 2), s(0, 1) - s(1, 0),  //
      s(1, 2) - s(2, 1), s(0, 0) - s(1, 1) - s(2, 2), s(0, 1) + s(1, 0), s(2, 0) + s(0, 2), s(2, 0) - s(0, 2),
      s(0, 1) + s(1, 0), s(1, 1) - s(0, 0) - s(2, 2), s(1, 2) + s(2, 1), s(0, 1) - s(1, 0), s(2, 0) + s(0, 2),
      s(1, 2) + s(2, 1), s(2, 2) - s(0, 0) - s(1, 1);
  const Eigen::Vector4d q = symmetricEigen(n).vectors.col(3);
  const Eigen::Quaterniond rotation(q(0), q(1), q(2), q(3));
  return SE3(rotation, mean_a - rotation * mean_b);
}

double squaredDistance(const PointPair& pair, const SE3& T_a_b, const Eigen::Matrix3d& rotation) {
  const Eigen::Vector3d e = pair.a - (rotation * pair.b + T_a_b.translation());
  const Eigen::Matrix3d c = pair.covariance_a + rotation * pair.covariance_b * rotation.transpose();
  return e.dot(c.inverse() * e);
}

std::optional<Hypothesis> sampleConsensus(const std::vector<PointPair>& pairs, const SampleConfig& config,
                                          PoseTest plausible, const void* context) {
  if (pairs.size() < 4) return std::nullopt;
  std::mt19937 random(config.seed);
  const auto n = static_cast<std::uint32_t>(pairs.size());
  Hypothesis best;
  best.cost = config.gate * static_cast<double>(n);
  int hypotheses = 0;
  double needed = config.max_samples;
  std::vector<int> chosen(3), inliers;
  for (int sample = 0; sample < needed && hypotheses < config.max_hypotheses; ++sample) {
    for (int& k : chosen) k = static_cast<int>(random() % n);
    const PointPair &p = pairs[static_cast<std::size_t>(chosen[0])],
                    &q = pairs[static_cast<std::size_t>(chosen[1])],
                    &r = pairs[static_cast<std::size_t>(chosen[2])];
    if (!sameSide(p, q) || !sameSide(q, r) || !sameSide(r, p)) continue;
    const auto pose = absoluteOrientation(pairs, chosen);
    if (!pose || (plausible != nullptr && !plausible(context, *pose))) continue;
    ++hypotheses;
    const Eigen::Matrix3d rotation = pose->matrix3();
    inliers.clear();
    double cost = 0;
    for (std::uint32_t k = 0; k < n && cost < best.cost; ++k) {
      const double d = squaredDistance(pairs[k], *pose, rotation);
      cost += std::min(d, config.gate);
      if (d < config.gate) inliers.push_back(static_cast<int>(k));
    }
    if (cost >= best.cost || inliers.size() < 4) continue;
    best = {*pose, inliers, cost};
    const double share = static_cast<double>(inliers.size()) / n;
    // A clean set's pose is noisy: not every one finds all inliers.
    constexpr double kLuck = 0.3;
    const double hit = kLuck * share * share * share;
    if (hit < 1)
      needed = std::min<double>(config.max_samples, std::log(1 - config.confidence) / std::log1p(-hit));
  }
  if (best.inliers.empty()) return std::nullopt;
  return best;
}

SE3 refineCauchy(const std::vector<PointPair>& pairs, const SE3& start) {
  constexpr int kIterations = 10;
  constexpr double kScale = 2;         // c, standard deviations
  constexpr double kConverged = 1e-6;  // [m, rad]
  SE3 pose = start;
  for (int i = 0; i < kIterations; ++i) {
    NormalEquations<6> equations;
    const Eigen::Matrix3d rotation = pose.matrix3();
    for (const PointPair& p : pairs) {
      const Eigen::Vector3d e = p.a - pose * p.b;
      const Eigen::Matrix3d information = informationOf(p, rotation);
      equations.add(byPose(p, rotation), e, information / (1 + e.dot(information * e) / (kScale * kScale)));
    }
    Vector6d step;
    if (!solveStep(equations.h, equations.b, step)) return start;
    pose = perturbed(pose, step);
    if (step.norm() < kConverged) break;
  }
  return pose;
}

std::optional<Alignment> alignPoints(const std::vector<PointPair>& pairs, const SE3& start) {
  constexpr int kIterations = 15;
  constexpr double kConverged = 1e-6;  // [m, rad, standard deviations of the shared errors]
  constexpr int kUnknowns = 6 + kSharedErrors;
  using Shared = Eigen::Matrix<double, kSharedErrors, 1>;
  Alignment result;
  result.T_a_b = start;
  Shared shared = Shared::Zero();
  for (int i = 0; i < kIterations; ++i) {
    const Eigen::Matrix3d rotation = result.T_a_b.matrix3();
    const double gate = kInlierGate * result.noise * result.noise;
    NormalEquations<kUnknowns> equations;
    std::vector<int> inliers;
    double sum = 0;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const PointPair& p = pairs[k];
      const SharedJacobian by_shared = rotation * p.shared_b - p.shared_a;
      const Eigen::Vector3d e = p.a - result.T_a_b * p.b + by_shared * shared;
      const Eigen::Matrix3d information = informationOf(p, rotation);
      const double d = e.dot(information * e);
      if (!(d < gate)) continue;
      inliers.push_back(static_cast<int>(k));
      Eigen::Matrix<double, 3, kUnknowns> j;
      j << byPose(p, rotation), by_shared;
      equations.add(j, e, information);
      sum += d;
    }
    const auto count = static_cast<double>(inliers.size());
    if (inliers.size() < 4) return std::nullopt;
    // The pose takes six of the 3 n degrees of freedom.
    result.noise = std::clamp(std::sqrt(sum / (kInlierMean * (count - 2))), kMinNoise, kMaxNoise);
    const double variance = result.noise * result.noise;
    equations.h.bottomRightCorner<kSharedErrors, kSharedErrors>().diagonal().array() += variance;
    equations.b.tail<kSharedErrors>() -= variance * shared;
    Eigen::Matrix<double, kUnknowns, 1> step;
    if (!equations.solve(step)) return std::nullopt;
    const bool same = inliers == result.inliers;
    result.inliers = std::move(inliers);
    result.covariance =
        variance * equations.factor.solve(decltype(equations)::Matrix::Identity()).topLeftCorner<6, 6>();
    result.covariance = 0.5 * (result.covariance + result.covariance.transpose()).eval();
    result.T_a_b = perturbed(result.T_a_b, step.head<6>());
    shared += step.tail<kSharedErrors>();
    if (same && step.norm() < kConverged) break;
  }
  return result;
}

}  // namespace fathom::closure
