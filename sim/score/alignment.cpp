#include "sim/score/alignment.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::sim {
namespace {

Eigen::Vector3d mean(const Points& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) sum += p;
  return sum / static_cast<double>(points.size());
}

double squaredError(const Points& estimate, const TruthSurface& truth, const SE3& motion) {
  double sum = 0;
  for (const Eigen::Vector3d& p : estimate) {
    const double d = truth.nearest(motion * p).distance;
    sum += d * d;
  }
  return sum;
}

}  // namespace

SE3 alignRigid(const Points& estimate, const Points& truth) {
  if (estimate.empty()) return {};
  Eigen::Matrix3Xd from(3, estimate.size()), to(3, truth.size());
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) = estimate[i];
    to.col(static_cast<Eigen::Index>(i)) = truth[i];
  }
  const Eigen::Matrix4d m = rigidAlignment(from, to);
  return {Eigen::Matrix3d(m.topLeftCorner<3, 3>()), Eigen::Vector3d(m.topRightCorner<3, 1>())};
}

SE3 alignLevel(const Points& estimate, const Points& truth) {
  if (estimate.empty()) return {};
  const Eigen::Vector3d from = mean(estimate), to = mean(truth);
  double sine = 0, cosine = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const Eigen::Vector3d a = estimate[i] - from, b = truth[i] - to;
    sine += a.x() * b.y() - a.y() * b.x();
    cosine += a.x() * b.x() + a.y() * b.y();
  }
  const SE3 turn = SE3::fromEuler(0, 0, sine == 0 ? 0 : std::atan2(sine, cosine), Eigen::Vector3d::Zero());
  return {turn.rotation(), to - turn.rotation() * from};
}

SE3 alignSurface(const Points& estimate, const TruthSurface& truth, const SE3& start) {
  constexpr int kIterations = 30;
  constexpr double kConverged = 1e-6;  // last step [m, rad]
  constexpr double kOutlier = 3.0;     // medians
  constexpr double kDamping = 1e-9;    // relative; a plane leaves three motions free
  if (estimate.size() < 6) return start;

  SE3 motion = start;
  std::vector<TruthSurface::Nearest> nearest(estimate.size());
  std::vector<double> distances(estimate.size());
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    tbb::parallel_for(std::size_t{0}, estimate.size(), [&](std::size_t i) {
      nearest[i] = truth.nearest(motion * estimate[i]);
      distances[i] = nearest[i].distance;
    });
    const double limit = std::max(kOutlier * median(std::span(distances)), 1e-9);

    // Turns about the points' centre, so that turn and shift do not mix.
    const Eigen::Vector3d centre = motion * mean(estimate);
    Matrix6d normal = Matrix6d::Zero();
    Vector6d right = Vector6d::Zero();
    for (std::size_t i = 0; i < estimate.size(); ++i) {
      if (nearest[i].distance > limit || !nearest[i].normal.allFinite()) continue;
      const Eigen::Vector3d p = motion * estimate[i];
      Vector6d row;
      row << nearest[i].normal, (p - centre).cross(nearest[i].normal);
      const double residual = nearest[i].normal.dot(nearest[i].point - p);
      normal += row * row.transpose();
      right += row * residual;
    }
    normal.diagonal().array() += kDamping * normal.trace();
    const Vector6d step = normal.ldlt().solve(right);
    if (!step.allFinite()) break;
    Vector6d turn = Vector6d::Zero();
    turn.tail<3>() = step.tail<3>();
    const SE3 to_centre(Eigen::Quaterniond::Identity(), -centre);
    const SE3 back(Eigen::Quaterniond::Identity(), centre + step.head<3>());
    motion = back * SE3::exp(turn) * to_centre * motion;
    if (step.norm() < kConverged) break;
  }
  return squaredError(estimate, truth, motion) < squaredError(estimate, truth, start) ? motion : start;
}

}  // namespace fathom::sim
