#include "recon/calibration/rig_bundle.hpp"

#include <ceres/ceres.h>
#include <glog/logging.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>

namespace fathom::calibration {
namespace {

constexpr int kCamera = 8, kQuaternion = 4, kVector = 3;  // kCamera: without k3
using Intrinsics = std::array<double, kCamera>;

// Camera::project(), with the initial camera's k3, less the measured pixel; false behind the camera.
template <typename T>
bool projectionError(const T* camera, double k3, const Eigen::Matrix<T, 3, 1>& p,
                     const Eigen::Vector2d& measured, T* residual) {
  if (p.z() <= T(0)) return false;
  const T x = p.x() / p.z(), y = p.y() / p.z();
  const T r2 = x * x + y * y;
  const T radial = T(1) + r2 * (camera[4] + r2 * (camera[5] + r2 * k3));
  const T dx = x * radial + T(2) * camera[6] * x * y + camera[7] * (r2 + T(2) * x * x);
  const T dy = y * radial + camera[6] * (r2 + T(2) * y * y) + T(2) * camera[7] * x * y;
  residual[0] = camera[0] * dx + camera[2] - T(measured.x());
  residual[1] = camera[1] * dy + camera[3] - T(measured.y());
  return true;
}

template <typename T>
Eigen::Matrix<T, 3, 1> moved(const T* quaternion, const Eigen::Matrix<T, 3, 1>& translation,
                             const Eigen::Matrix<T, 3, 1>& point) {
  return Eigen::Map<const Eigen::Quaternion<T>>(quaternion) * point + translation;
}

template <typename T>
using Vector3 = Eigen::Matrix<T, 3, 1>;
template <typename T>
using Vector3In = Eigen::Map<const Vector3<T>>;

struct LeftSighting {
  Eigen::Vector2d pixel;
  double k3;

  template <typename T>
  bool operator()(const T* camera, const T* q, const T* t, const T* point, T* residual) const {
    const Vector3<T> p = moved<T>(q, Vector3In<T>(t), Vector3In<T>(point));
    return projectionError(camera, k3, p, pixel, residual);
  }
};

struct RightSighting {
  Eigen::Vector2d pixel;
  double k3, baseline;

  template <typename T>
  bool operator()(const T* camera, const T* rig_q, const T* rig_direction, const T* q, const T* t,
                  const T* point, T* residual) const {
    const Vector3<T> in_left = moved<T>(q, Vector3In<T>(t), Vector3In<T>(point));
    const Vector3<T> p = moved<T>(rig_q, T(baseline) * Vector3In<T>(rig_direction), in_left);
    return projectionError(camera, k3, p, pixel, residual);
  }
};

// In standard deviations.
struct PriorResidual {
  CameraPrior prior;
  int width, height;
  static constexpr int kResiduals = 7;

  template <typename T>
  bool operator()(const T* camera, T* residual) const {
    const double centre = prior.centre * width;
    residual[0] = (camera[2] - T(0.5 * (width - 1))) / centre;
    residual[1] = (camera[3] - T(0.5 * (height - 1))) / centre;
    residual[2] = ceres::log(camera[1] / camera[0]) / prior.aspect;
    residual[3] = camera[4] / prior.k1;
    residual[4] = camera[5] / prior.k2;
    residual[5] = camera[6] / prior.tangential;
    residual[6] = camera[7] / prior.tangential;
    return true;
  }
};

Intrinsics numbersOf(const Camera& camera) {
  Intrinsics out;
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = camera.*kIntrinsics[i];
  return out;
}

// A bundle as a problem of Ceres; `sigma`: of a coordinate of a sighting, which weighs it against the priors
// [px].
class Problem {
 public:
  Problem(const RigBundle& bundle, const RigBundleConfig& config, double sigma) : bundle_(bundle) {
    left_ = numbersOf(bundle.rig.left);
    right_ = numbersOf(bundle.rig.right);
    baseline_ = bundle.rig.T_right_left.translation().norm();
    rig_q_ = bundle.rig.T_right_left.rotation();
    rig_direction_ = bundle.rig.T_right_left.translation() / baseline_;
    points_ = bundle.points;
    for (const RigBundle::Pose& pose : bundle.poses) {
      q_.push_back(pose.T_left_world.rotation());
      t_.push_back(pose.T_left_world.translation());
    }
    build(config, sigma);
  }

  ceres::Problem& ceres() { return problem_; }

  void store(RigBundle& bundle) const {
    for (std::size_t i = 0; i < left_.size(); ++i) {
      bundle.rig.left.*kIntrinsics[i] = left_[i];
      bundle.rig.right.*kIntrinsics[i] = right_[i];
    }
    bundle.rig.T_right_left = SE3(rig_q_, baseline_ * rig_direction_);
    for (std::size_t i = 0; i < q_.size(); ++i) bundle.poses[i].T_left_world = SE3(q_[i], t_[i]);
    bundle.points = points_;
  }

  // Of both cameras, the rig's rotation vector applied on the left, and its translation.
  bool uncertainty(RigSigma& sigma) {
    FLAGS_minloglevel = google::GLOG_FATAL;  // a singular system is a result here, not a warning on stderr
    ceres::Covariance::Options options;
    options.num_threads = 1;
    ceres::Covariance covariance(options);
    const double* blocks[] = {left_.data(), right_.data(), rig_q_.coeffs().data(), rig_direction_.data()};
    std::vector<std::pair<const double*, const double*>> wanted;
    for (const double* block : blocks) wanted.emplace_back(block, block);
    if (!covariance.Compute(wanted, &problem_)) return false;
    const auto cameraSigma = [&](const Intrinsics& camera, CameraSigma& out) {
      Eigen::Matrix<double, kCamera, kCamera, Eigen::RowMajor> c;
      covariance.GetCovarianceBlock(camera.data(), camera.data(), c.data());
      for (int i = 0; i < kCamera; ++i)
        out.*kIntrinsicSigmas[static_cast<std::size_t>(i)] = std::sqrt(std::max(0.0, c(i, i)));
    };
    cameraSigma(left_, sigma.left);
    cameraSigma(right_, sigma.right);
    Eigen::Matrix<double, kQuaternion, kQuaternion, Eigen::RowMajor> of_q;
    covariance.GetCovarianceBlock(rig_q_.coeffs().data(), rig_q_.coeffs().data(), of_q.data());
    // Twice the vector of dq q^-1: a column for each of x, y, z, w of q.
    Eigen::Matrix<double, 3, kQuaternion> turn;
    for (int i = 0; i < kQuaternion; ++i)
      turn.col(i) = 2 * (Eigen::Quaterniond(Eigen::Vector4d::Unit(i)) * rig_q_.conjugate()).vec();
    sigma.rotation = (turn * of_q * turn.transpose()).diagonal().cwiseMax(0).cwiseSqrt();
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> of_direction;
    covariance.GetCovarianceBlock(rig_direction_.data(), rig_direction_.data(), of_direction.data());
    sigma.translation = baseline_ * of_direction.diagonal().cwiseMax(0).cwiseSqrt();
    sigma.baseline = 0;
    return true;
  }

 private:
  void build(const RigBundleConfig& config, double sigma) {
    problem_.AddParameterBlock(rig_q_.coeffs().data(), kQuaternion, new ceres::EigenQuaternionManifold);
    problem_.AddParameterBlock(rig_direction_.data(), kVector, new ceres::SphereManifold<kVector>);
    for (std::size_t i = 0; i < q_.size(); ++i) {
      problem_.AddParameterBlock(q_[i].coeffs().data(), kQuaternion, new ceres::EigenQuaternionManifold);
      problem_.AddParameterBlock(t_[i].data(), kVector);
      if (!bundle_.poses[i].fixed) continue;
      problem_.SetParameterBlockConstant(q_[i].coeffs().data());
      problem_.SetParameterBlockConstant(t_[i].data());
    }
    const auto loss = [&] {
      return new ceres::ScaledLoss(new ceres::CauchyLoss(config.loss_px), 1 / (sigma * sigma),
                                   ceres::TAKE_OWNERSHIP);
    };
    for (const RigBundle::Sighting& s : bundle_.sightings) {
      if (!s.used) continue;
      double *q = q_[s.pose].coeffs().data(), *t = t_[s.pose].data(), *point = points_[s.point].data();
      if (s.right)
        problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<RightSighting, 2, kCamera, kQuaternion,
                                                                  kVector, kQuaternion, kVector, kVector>(
                                      new RightSighting{s.pixel, bundle_.rig.right.k3, baseline_}),
                                  loss(), right_.data(), rig_q_.coeffs().data(), rig_direction_.data(), q, t,
                                  point);
      else
        problem_.AddResidualBlock(
            new ceres::AutoDiffCostFunction<LeftSighting, 2, kCamera, kQuaternion, kVector, kVector>(
                new LeftSighting{s.pixel, bundle_.rig.left.k3}),
            loss(), left_.data(), q, t, point);
    }
    const auto addPrior = [&](const Camera& camera, Intrinsics& numbers) {
      problem_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<PriorResidual, PriorResidual::kResiduals, kCamera>(
              new PriorResidual{config.prior, camera.width, camera.height}),
          nullptr, numbers.data());
      problem_.SetParameterLowerBound(numbers.data(), 0, kShortest * camera.width);
      problem_.SetParameterLowerBound(numbers.data(), 1, kShortest * camera.width);
    };
    addPrior(bundle_.rig.left, left_);
    addPrior(bundle_.rig.right, right_);
  }

  static constexpr double kShortest = 0.2;  // focal length [image widths]
  const RigBundle& bundle_;
  Intrinsics left_, right_;
  double baseline_;
  Eigen::Quaterniond rig_q_;
  Eigen::Vector3d rig_direction_;
  std::vector<Eigen::Quaterniond> q_;
  std::vector<Eigen::Vector3d> t_, points_;
  ceres::Problem problem_;
};

// Of a coordinate, by the used sightings; each point takes three and each pose six of them.
double scatter(const RigBundle& bundle) {
  double squares = 0, count = 0;
  std::set<std::uint32_t> points, poses;
  for (const RigBundle::Sighting& s : bundle.sightings) {
    if (!s.used) continue;
    squares += bundle.residual(s).squaredNorm();
    count += 2;
    points.insert(s.point);
    poses.insert(s.pose);
  }
  const auto taken = static_cast<double>(3 * points.size() + 6 * poses.size());
  constexpr double kLeast = 0.05;  // no detector is better than this [px]
  return std::max(kLeast, std::sqrt(squares / std::max(1.0, count - taken)));
}

}  // namespace

Eigen::Vector2d RigBundle::residual(const Sighting& sighting) const {
  Eigen::Vector3d p = poses[sighting.pose].T_left_world * points[sighting.point];
  if (sighting.right) p = rig.T_right_left * p;
  constexpr double kNearest = 1e-3, kFar = 1e6;  // [m]; [px]
  if (p.z() < kNearest) return Eigen::Vector2d::Constant(kFar);
  return sighting.pixel - (sighting.right ? rig.right : rig.left).project(p);
}

void adjust(RigBundle& bundle, const RigBundleConfig& config) {
  Problem problem(bundle, config, config.loss_px);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.max_num_iterations = config.steps;
  options.function_tolerance = 1e-7;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem.ceres(), &summary);
  if (summary.IsSolutionUsable()) problem.store(bundle);
}

bool bundleUncertainty(const RigBundle& bundle, const RigBundleConfig& config, RigSigma& sigma) {
  return Problem(bundle, config, scatter(bundle)).uncertainty(sigma);
}

}  // namespace fathom::calibration
