#include "recon/stereo/depth_consistency.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace fathom::stereo {
namespace {

constexpr double kSigmas = 3.0;         // width of a gate
constexpr double kMadToSigma = 1.4826;  // of a normal distribution
constexpr int kAgreeing = 2;            // neighbours that vouch for a point
constexpr double kAgreeingSlope = 1.0;  // tangent of the slope up to which a neighbour vouches: 45 degrees

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Whether an edge between two points could lie on a surface seen under less than the slope whose tangent is
// given; sigma_a and sigma_b are their standard deviations along the line of sight [m].
bool onSurface(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double sigma_a, double sigma_b,
               double tangent) {
  const Eigen::Vector3d edge = b - a;
  const double along = std::abs(edge.dot((a + b).normalized()));
  const double across = std::sqrt(std::max(edge.squaredNorm() - along * along, 0.0));
  return along - kSigmas * std::hypot(sigma_a, sigma_b) <= tangent * across;
}

}  // namespace

void DepthConsistency::check(const DepthConsistencyConfig& config, std::span<const Eigen::Vector3d> points,
                             std::span<const std::array<std::uint32_t, 3>> triangles,
                             std::vector<std::uint8_t>& keep) {
  keep.assign(points.size(), 1);
  linkNeighbours(points.size(), triangles);
  dropMismatches(config, points, keep);
  dropPatches(config, points, keep);
}

void DepthConsistency::linkNeighbours(std::size_t points,
                                      std::span<const std::array<std::uint32_t, 3>> triangles) {
  edges_.clear();
  for (const auto& t : triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      edges_.push_back({t[i], t[(i + 1) % 3]});
      edges_.push_back({t[(i + 1) % 3], t[i]});
    }
  }
  std::sort(edges_.begin(), edges_.end());
  edges_.erase(std::unique(edges_.begin(), edges_.end()), edges_.end());
  first_.assign(points + 1, 0);
  neighbours_.clear();
  for (const auto& [from, to] : edges_) {
    ++first_[from + 1];
    neighbours_.push_back(to);
  }
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
}

void DepthConsistency::dropMismatches(const DepthConsistencyConfig& config,
                                      std::span<const Eigen::Vector3d> points,
                                      std::vector<std::uint8_t>& keep) {
  const double scale = config.baseline * config.focal;                    // disparity times depth [px m]
  const double gate = kSigmas * config.sigma_disparity * std::sqrt(2.0);  // of a difference [px]
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double own = scale / points[i].z();
    const double sigma = config.sigma_disparity / scale * points[i].z() * points[i].z();  // [m]
    values_.clear();
    int agreeing = 0;
    for (std::uint32_t k = first_[i]; k < first_[i + 1]; ++k) {
      const Eigen::Vector3d& other = points[neighbours_[k]];
      values_.push_back(scale / other.z());
      agreeing += onSurface(points[i], other, sigma, sigma, kAgreeingSlope) ? 1 : 0;
    }
    if (values_.empty() || agreeing >= kAgreeing) continue;
    const double middle = median(values_);
    deviations_.clear();
    for (const double v : values_) deviations_.push_back(std::abs(v - middle));
    if (std::abs(own - middle) > gate + kSigmas * kMadToSigma * median(deviations_)) keep[i] = 0;
  }
}

void DepthConsistency::dropPatches(const DepthConsistencyConfig& config,
                                   std::span<const Eigen::Vector3d> points, std::vector<std::uint8_t>& keep) {
  const double tangent = std::tan(config.max_slope);
  const double per_square = config.sigma_disparity / (config.baseline * config.focal);  // sigma_z / z^2 [1/m]
  group_.resize(points.size());
  std::iota(group_.begin(), group_.end(), 0U);
  const auto root = [&](std::uint32_t i) {
    while (group_[i] != i) i = group_[i] = group_[group_[i]];
    return i;
  };
  for (const auto& [a, b] : edges_) {
    if (a > b || keep[a] == 0 || keep[b] == 0) continue;
    const double za = points[a].z(), zb = points[b].z();
    if (!onSurface(points[a], points[b], per_square * za * za, per_square * zb * zb, tangent)) continue;
    const std::uint32_t ra = root(a), rb = root(b);
    group_[std::max(ra, rb)] = std::min(ra, rb);
  }
  size_.assign(points.size(), 0);
  for (std::uint32_t i = 0; i < points.size(); ++i)
    if (keep[i] != 0) ++size_[root(i)];
  for (std::uint32_t i = 0; i < points.size(); ++i)
    if (size_[root(i)] < static_cast<std::uint32_t>(config.min_patch_points)) keep[i] = 0;
}

}  // namespace fathom::stereo
