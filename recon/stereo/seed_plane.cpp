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

std::optional<SeedPlane> fitted(std::span<const StereoPoint> points, std::span<double> scratch) {
  if (points.size() < kMinPoints) return std::nullopt;
  const std::span<double> values = scratch.first(points.size());
  const auto rayOf = [&](std::size_t i) -> Eigen::Vector3d {
    const Eigen::Vector3d p = points[i].point.cast<double>();
    return p / p.z();
  };
  const auto inverseDepth = [&](std::size_t i) { return 1.0 / static_cast<double>(points[i].point.z()); };
  // From the median: a least-squares start would follow gross errors.
  for (std::size_t i = 0; i < points.size(); ++i) values[i] = inverseDepth(i);
  Eigen::Vector3d plane(0, 0, median(values));
  for (int k = 0; k < kIterations; ++k) {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = inverseDepth(i) - rayOf(i).dot(plane);
    const double scale = kCauchy * std::max(madSigma(values, 0), kMinSigma);
    Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d ray = rayOf(i);
      const double off = (inverseDepth(i) - ray.dot(plane)) / scale, weight = 1 / (1 + off * off);
      h += weight * ray * ray.transpose();
      b += weight * inverseDepth(i) * ray;
    }
    const Eigen::Vector3d spread = symmetricEigenvalues(h);
    if (!(spread(0) > kMinSpread * spread(2))) return std::nullopt;
    plane = h.ldlt().solve(b);
  }
  const double length = plane.norm();
  if (!(plane.z() > 0) || !std::isfinite(length)) return std::nullopt;
  return SeedPlane{plane / length, 1.0 / length};
}

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
  std::vector<double> scratch(points.size());
  return fitted(points, scratch);
}

std::optional<SeedPlane> groundElsewhere(std::span<const StereoPoint> points, const SeedPlane& seed,
                                         std::span<double> scratch) {
  constexpr double kElsewhere = 1.5, kMaybe = 1.3;  // of the seed's range; of points' median, worth a fit
  const auto apart = [&](double range) { return std::abs(std::log(range / seed.ahead())); };
  const std::span<double> depths = scratch.first(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) depths[i] = static_cast<double>(points[i].point.z());
  if (points.empty() || apart(median(depths)) < std::log(kMaybe)) return std::nullopt;
  const auto ground = fitted(points, scratch);
  return ground && apart(ground->ahead()) > std::log(kElsewhere) ? ground : std::nullopt;
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
