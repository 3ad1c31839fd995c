#include "recon/stereo/local_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "recon/geometry/image_view.hpp"

namespace fathom::stereo {
namespace {

constexpr double kSigmas = 3.0;         // width of a gate
constexpr int kAgreeing = 2;            // neighbours that confirm a point
constexpr double kAgreeingSlope = 1.0;  // tangent of the steepest slope to a confirming neighbour: 45 degrees
constexpr std::size_t kFew = 4;         // corners a point, with more of which a match may be chance
constexpr std::size_t kBeyondChance = 20;  // so many points that agree are none

// Fish. Sloping flanks of boulders stay joined; a fish 0.3 m above the floor does not join it across the
// usual 5 to 10 cm between corners.
constexpr double kFishSlope = 2.0;             // tangent
constexpr double kFishGap = 0.15;              // least step down [m]
constexpr double kFishGapPerWidth = 1.0;       // least step down, of the group's width
constexpr double kShallowShare = 0.1;          // of the leaving edges may step down less
constexpr std::uint32_t kMinFishPoints = 3;    // fewer have no shape
constexpr std::uint32_t kFishPartOfFrame = 4;  // a fish has no more than one in so many points
constexpr double kEdgePerSigma = 4.0;          // full width of an ellipse, evenly filled, over its sigma

bool isSurface(const SparseStereoConfig& limits, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
               const Eigen::Vector3d& c) {
  const double longest = std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
  if (longest > limits.max_edge * limits.max_edge) return false;
  const Eigen::Vector3d normal = (b - a).cross(c - a), sight = a + b + c;
  return std::abs(normal.dot(sight)) > std::cos(limits.max_slope) * normal.norm() * sight.norm();
}

// Checks the triangle's middle and those of its sides.
bool spansHidden(const ImageMask& mask, const Eigen::Vector2f& a, const Eigen::Vector2f& b,
                 const Eigen::Vector2f& c) {
  for (const Eigen::Vector2f& at : {Eigen::Vector2f((a + b + c) / 3), Eigen::Vector2f((a + b) / 2),
                                    Eigen::Vector2f((b + c) / 2), Eigen::Vector2f((c + a) / 2)})
    if (mask.hides(at.cast<double>())) return true;
  return false;
}

}  // namespace

DepthConsistency::DepthConsistency(std::size_t max_points) : links_(max_points) {
  nodes_.reserve(max_points);
  values_.reserve(max_points);
  joined_.reserve(max_points);
  group_.reserve(max_points);
  groups_.reserve(max_points);
}

void DepthConsistency::check(const DepthConsistencyConfig& config, std::span<const StereoPoint> points,
                             std::span<const std::array<std::uint32_t, 3>> triangles,
                             std::vector<Verdict>& verdicts) {
  verdicts.assign(points.size(), Verdict::kKeep);
  nodes_.clear();
  for (const StereoPoint& p : points) {
    const Eigen::Vector3d position = p.point.cast<double>();
    const double range = position.norm(), sigma = static_cast<double>(p.sigma_z) * range / position.z();
    nodes_.push_back({position, position / range, range, 1.0 / position.z(), sigma * sigma});
  }
  links_.build(points.size(), triangles);
  if (config.few)
    dropChance(verdicts);
  else
    dropMismatches(verdicts);
  if (config.max_fish_length > 0) dropFish(config, verdicts);
  dropPatches(config, verdicts);
}

// Whether an edge between two points can be on a surface up to the slope of this tangent.
bool DepthConsistency::onSurface(const Node& a, const Node& b, double tangent) const {
  const Eigen::Vector3d edge = b.position - a.position;
  const double along = 0.5 * std::abs(edge.dot(a.sight + b.sight));
  const double across = std::sqrt(std::max(edge.squaredNorm() - along * along, 0.0));
  return along - kSigmas * std::sqrt(a.variance + b.variance) <= tangent * across;
}

int DepthConsistency::agreeing(std::uint32_t i) const {
  const auto all = links_.neighbours(i);
  return static_cast<int>(std::count_if(all.begin(), all.end(), [&](std::uint32_t k) {
    return onSurface(nodes_[i], nodes_[k], kAgreeingSlope);
  }));
}

void DepthConsistency::dropChance(std::vector<Verdict>& verdicts) {
  std::size_t confirmed = 0;
  for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
    const int agree = agreeing(i);
    if (agree >= kAgreeing && 2 * agree >= static_cast<int>(links_.neighbours(i).size()))
      ++confirmed;
    else
      verdicts[i] = Verdict::kMismatch;
  }
  if (confirmed < kBeyondChance || 2 * confirmed < nodes_.size())
    std::fill(verdicts.begin(), verdicts.end(), Verdict::kMismatch);
}

void DepthConsistency::dropMismatches(std::vector<Verdict>& verdicts) {
  for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
    const Node& own = nodes_[i];
    values_.clear();
    double variance = 0;
    for (const std::uint32_t k : links_.neighbours(i)) {
      values_.push_back(nodes_[k].inverse_depth);
      variance += nodes_[k].variance;
    }
    if (values_.empty() || agreeing(i) >= kAgreeing) continue;
    const double sigma = std::sqrt(own.variance + variance / static_cast<double>(values_.size())) *
                         own.inverse_depth * own.inverse_depth;
    const double middle = median(std::span(values_));
    if (std::abs(own.inverse_depth - middle) > kSigmas * (sigma + madSigma(std::span(values_), middle)))
      verdicts[i] = Verdict::kMismatch;
  }
}

void DepthConsistency::join(double tangent, const std::vector<Verdict>& verdicts) {
  joined_.reset(nodes_.size());
  for (std::uint32_t a = 0; a < nodes_.size(); ++a) {
    if (verdicts[a] != Verdict::kKeep) continue;
    for (const std::uint32_t b : links_.neighbours(a)) {
      if (b < a || verdicts[b] != Verdict::kKeep || !onSurface(nodes_[a], nodes_[b], tangent)) continue;
      joined_.join(a, b);
    }
  }
  group_.resize(nodes_.size());
  for (std::uint32_t i = 0; i < nodes_.size(); ++i) group_[i] = joined_.root(i);
}

void DepthConsistency::dropFish(const DepthConsistencyConfig& config, std::vector<Verdict>& verdicts) {
  join(kFishSlope, verdicts);
  groups_.assign(nodes_.size(), Group{});
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (verdicts[i] != Verdict::kKeep) continue;
    const Node& node = nodes_[i];
    Group& g = groups_[group_[i]];
    const double x = node.position.x() / node.position.z(), y = node.position.y() / node.position.z();
    ++g.points;
    g.outline |= links_.onOutline(i);
    for (const std::uint32_t k : links_.neighbours(i)) g.outline |= links_.onOutline(k);
    g.x += x;
    g.y += y;
    g.xx += x * x;
    g.xy += x * y;
    g.yy += y * y;
    g.depth += node.position.z();
  }
  for (Group& g : groups_) {
    if (g.outline || g.points < kMinFishPoints || g.points * kFishPartOfFrame > nodes_.size()) continue;
    const double n = g.points, depth = g.depth / n;
    const double xx = g.xx / n - g.x * g.x / (n * n), yy = g.yy / n - g.y * g.y / (n * n);
    const double xy = g.xy / n - g.x * g.y / (n * n);
    const double middle = 0.5 * (xx + yy), spread = hypotenuse(0.5 * (xx - yy), xy);
    const double length = kEdgePerSigma * depth * std::sqrt(middle + spread);
    const double width = kEdgePerSigma * depth * std::sqrt(std::max(middle - spread, 0.0));
    if (length <= config.max_fish_length) g.needed = std::max(kFishGap, kFishGapPerWidth * width);
  }
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (verdicts[i] != Verdict::kKeep) continue;
    Group& g = groups_[group_[i]];
    if (g.needed == 0) continue;
    for (const std::uint32_t k : links_.neighbours(i)) {
      if (verdicts[k] != Verdict::kKeep || group_[k] == group_[i]) continue;
      ++g.leaving;
      g.shallow += nodes_[k].range - nodes_[i].range < g.needed ? 1 : 0;
    }
  }
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const Group& g = groups_[group_[i]];
    if (verdicts[i] == Verdict::kKeep && g.needed > 0 && g.leaving > 0 &&
        g.shallow <= kShallowShare * g.leaving)
      verdicts[i] = Verdict::kFish;
  }
}

void DepthConsistency::dropPatches(const DepthConsistencyConfig& config, std::vector<Verdict>& verdicts) {
  join(std::tan(config.max_slope), verdicts);
  groups_.assign(nodes_.size(), Group{});
  for (std::size_t i = 0; i < nodes_.size(); ++i)
    if (verdicts[i] == Verdict::kKeep) ++groups_[group_[i]].points;
  for (std::size_t i = 0; i < nodes_.size(); ++i)
    if (verdicts[i] == Verdict::kKeep &&
        groups_[group_[i]].points < static_cast<std::uint32_t>(config.min_patch_points))
      verdicts[i] = Verdict::kMismatch;
}

LocalMesh::LocalMesh(std::size_t max_points) : delaunay_(max_points), consistency_(max_points) {
  pixels_.reserve(max_points);
  verdicts_.reserve(max_points);
}

const std::vector<Delaunay::Triangle>& LocalMesh::triangulatePixels(const StereoResult& result) {
  pixels_.clear();
  for (const StereoPoint& p : result.points)
    pixels_.push_back({std::max(0, static_cast<std::int32_t>(std::lround(p.left.x()))),
                       std::max(0, static_cast<std::int32_t>(std::lround(p.left.y())))});
  return delaunay_.triangulate(pixels_);
}

void LocalMesh::dropOutliers(const SparseStereoConfig& limits, StereoResult& result) {
  using Verdict = DepthConsistency::Verdict;
  const bool few = kFew * result.points.size() < result.corners;
  consistency_.check({limits.max_slope, limits.min_patch_points, limits.max_fish_length, few}, result.points,
                     triangulatePixels(result), verdicts_);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < verdicts_.size(); ++i) {
    if (verdicts_[i] == Verdict::kKeep)
      result.points[kept++] = result.points[i];
    else
      ++(verdicts_[i] == Verdict::kFish ? result.rejected.fish : result.rejected.outlier);
  }
  result.points.resize(kept);
}

void LocalMesh::triangulate(const SparseStereoConfig& limits, StereoResult& result, const ImageMask* mask) {
  result.triangles.clear();
  const auto at = [&](std::uint32_t i) { return result.points[i].point.cast<double>(); };
  const auto pixel = [&](std::uint32_t i) -> const Eigen::Vector2f& { return result.points[i].left; };
  for (const Delaunay::Triangle& t : triangulatePixels(result)) {
    if (!isSurface(limits, at(t[0]), at(t[1]), at(t[2]))) continue;
    if (mask != nullptr && spansHidden(*mask, pixel(t[0]), pixel(t[1]), pixel(t[2]))) continue;
    // Reversed: counter-clockwise for the camera (y is down in its image).
    result.triangles.push_back({t[0], t[2], t[1]});
  }
}

}  // namespace fathom::stereo
