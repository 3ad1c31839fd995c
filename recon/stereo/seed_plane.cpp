#include "recon/stereo/seed_plane.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::stereo {
namespace {

constexpr double kMaxRadius = 256;      // [px]
constexpr std::size_t kMinPoints = 12;  // four for each parameter
constexpr int kIterations = 20;         // Cauchy's weights settle within ten
constexpr double kCauchy = 2.385;  // residual in sigmas at which half the weight is left: 95 % efficiency
constexpr double kMinSpread =
    1e-6;  // of the rays, smallest eigenvalue to largest: a field of view of 0.1 degrees
constexpr double kMinSigma = 1e-6;  // [1/m]: far below the resolution of a pixel

}  // namespace

WideSearch wideSearch(const StereoRig& rig, double min_range, double max_range) {
  const double focal_baseline =
      0.5 * (rig.left.fx + rig.left.fy) * rig.baseline();  // disparity times depth [px m]
  const double nearest = focal_baseline / min_range, farthest = focal_baseline / max_range;  // [px]
  WideSearch search;
  search.search_radius = std::clamp(0.5 * (nearest - farthest), 1.0, kMaxRadius);
  // Where the radius cannot reach both ends, it starts at the far one: surveys fly high over their
  // least depth.
  search.plane.distance = focal_baseline / (farthest + search.search_radius);
  return search;
}

std::optional<SeedPlane> fitSeedPlane(std::span<const StereoPoint> points) {
  if (points.size() < kMinPoints) return std::nullopt;
  const auto n = static_cast<Eigen::Index>(points.size());
  Eigen::MatrixX3d rays(n, 3);
  Eigen::VectorXd inverse_depth(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3d p = points[static_cast<std::size_t>(i)].point.cast<double>();
    rays.row(i) = (p / p.z()).transpose();
    inverse_depth(i) = 1.0 / p.z();
  }
  // From the median: a least-squares start would follow gross errors.
  std::vector<double> values(inverse_depth.begin(), inverse_depth.end());
  Eigen::Vector3d plane(0, 0, median(std::span(values)));
  for (int k = 0; k < kIterations; ++k) {
    const Eigen::VectorXd residual = inverse_depth - rays * plane;
    values.assign(residual.begin(), residual.end());
    const double scale = kCauchy * std::max(madSigma(std::span(values), 0), kMinSigma);
    const Eigen::VectorXd weight = (1.0 + (residual.array() / scale).square()).inverse();
    const Eigen::Matrix3d normal_matrix = rays.transpose() * weight.asDiagonal() * rays;
    const Eigen::Vector3d spread = symmetricEigenvalues(normal_matrix);
    if (!(spread(0) > kMinSpread * spread(2))) return std::nullopt;
    plane = normal_matrix.ldlt().solve(rays.transpose() * (weight.asDiagonal() * inverse_depth));
  }
  const double length = plane.norm();
  if (!(plane.z() > 0) || !std::isfinite(length)) return std::nullopt;
  return SeedPlane{plane / length, 1.0 / length};
}

PlaneScout::PlaneScout(const StereoRig& rig, SparseStereoConfig config)
    : wide_(wideSearch(rig, config.min_range, config.max_range)), stereo_(rig, [&] {
        constexpr int kFeatures = 400;  // enough for a plane through a reef
        config.search_radius = wide_.search_radius;
        config.max_features = kFeatures;
        return config;
      }()) {}

std::optional<SeedPlane> PlaneScout::find(const ImageView& left, const ImageView& right) {
  return fitSeedPlane(stereo_.process(left, right, wide_.plane).points);
}

}  // namespace fathom::stereo
