#include "recon/fusion/mesh_observations.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "realtime/base/numbers/portable_math.hpp"

namespace fathom::fusion {
namespace {

// Farther from nav's origin than any mission goes [m]; keeps tile indices within a place's 24 bits.
constexpr float kMaxPlanCoordinate = 1e5F;
// A triangle so thin in plan (a wall, or nearly) covers no cell: area over its longest edge squared.
constexpr double kThinnest = 1e-6;
// Longest edge of a triangle that is used, in root squares; stereo meshes have shorter ones.
constexpr double kMaxEdgeRoots = 4;
// Height error of a flat triangle, per metre of its size: seafloor between the points is interpolated,
// not seen.
constexpr double kInterpolationError = 0.05;

// A triangle in plan: x north, y east.
struct PlanTriangle {
  std::array<Eigen::Vector2d, 3> corner;
  double area2 = 0;  // twice the signed area [m^2]
  double longest_edge = 0;
  Eigen::Vector2d low, high;

  PlanTriangle(const Mesh& mesh, const std::array<std::uint32_t, 3>& t) {
    for (std::size_t k = 0; k < 3; ++k) corner[k] = mesh.vertices[t[k]].head<2>().cast<double>();
    const Eigen::Vector2d u = corner[1] - corner[0], v = corner[2] - corner[0];
    area2 = u.x() * v.y() - u.y() * v.x();
    longest_edge = std::max({u.norm(), v.norm(), (corner[2] - corner[1]).norm()});
    low = corner[0].cwiseMin(corner[1]).cwiseMin(corner[2]);
    high = corner[0].cwiseMax(corner[1]).cwiseMax(corner[2]);
  }

  // Barycentric weights of a point; false outside. Points on an edge belong to both triangles.
  bool weights(double x, double y, std::array<double, 3>& w) const {
    constexpr double kEdge = -1e-9;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector2d &a = corner[(k + 1) % 3], &b = corner[(k + 2) % 3];
      w[k] = ((a.x() - x) * (b.y() - y) - (a.y() - y) * (b.x() - x)) / area2;
      if (w[k] < kEdge) return false;
    }
    return true;
  }
};

bool isUsableInPlan(const Mesh& mesh, const std::array<std::uint32_t, 3>& t) {
  for (const std::uint32_t v : t) {
    if (v >= mesh.vertices.size()) return false;
    const Eigen::Vector3f& p = mesh.vertices[v];
    if (!p.allFinite() || p.cwiseAbs().maxCoeff() > kMaxPlanCoordinate) return false;
    if (!mesh.sigma.empty() && !(mesh.sigma[v] >= 0 && std::isfinite(mesh.sigma[v]))) return false;
  }
  return true;
}

std::uint64_t placeOf(int level, std::int64_t gi, std::int64_t gj) {
  constexpr std::int64_t kBias = 1 << 23;
  return (static_cast<std::uint64_t>(level) << 56) | (static_cast<std::uint64_t>((gi >> 4) + kBias) << 32) |
         (static_cast<std::uint64_t>((gj >> 4) + kBias) << 8) |
         static_cast<std::uint64_t>((gi & (kTileCells - 1)) * kTileCells + (gj & (kTileCells - 1)));
}

}  // namespace

MeshObservations::MeshObservations(const QuadtreeConfig& config) : config_(config) {
  found_.reserve(kMost);
}

int MeshObservations::levelFor(double point_spacing) const {
  const double wanted = config_.node_spacing_ratio * point_spacing;
  int level = 0;
  while (level < config_.max_level && spacing(level + 1) >= wanted) ++level;
  return level;
}

bool MeshObservations::observe(const Mesh& mesh, const std::array<std::uint32_t, 3>& t, int finest) {
  const PlanTriangle triangle(mesh, t);
  if (!(std::abs(triangle.area2) > kThinnest * triangle.longest_edge * triangle.longest_edge) ||
      !(triangle.longest_edge < kMaxEdgeRoots * config_.root_size))
    return true;
  // Half of the triangle's own spacing, so that only clearly sparse places are coarser than the mesh.
  const double size = std::sqrt(std::abs(triangle.area2));
  const int level = std::min(finest, levelFor(0.5 * size));
  const double step = spacing(level), interpolation = kInterpolationError * size;
  const auto first = [&](double x) { return static_cast<std::int64_t>(std::ceil(x / step - 0.5 - 1e-9)); };
  const auto last = [&](double x) { return static_cast<std::int64_t>(std::floor(x / step - 0.5 + 1e-9)); };
  const std::int64_t i1 = last(triangle.high.x()), j0 = first(triangle.low.y()), j1 = last(triangle.high.y());
  std::array<double, 3> w;
  for (std::int64_t i = first(triangle.low.x()); i <= i1; ++i) {
    for (std::int64_t j = j0; j <= j1; ++j) {
      if (!triangle.weights((static_cast<double>(i) + 0.5) * step, (static_cast<double>(j) + 0.5) * step, w))
        continue;
      if (found_.size() == kMost) return false;
      double depth = 0, sigma = 0;
      std::array<double, 3> colour{};
      for (std::size_t k = 0; k < 3; ++k) {
        depth += w[k] * static_cast<double>(mesh.vertices[t[k]].z());
        if (!mesh.sigma.empty()) sigma += w[k] * static_cast<double>(mesh.sigma[t[k]]);
        const Rgb& rgb = mesh.colours.empty() ? kUncolouredRgb : mesh.colours[t[k]];
        for (std::size_t c = 0; c < 3; ++c) colour[c] += w[k] * rgb[c];
      }
      CellObservation seen;
      seen.place = placeOf(level, i, j);
      seen.height = heightUnits(depth);
      seen.weight = static_cast<std::uint16_t>(
          weightOf(hypotenuse(std::max(sigma, config_.min_sigma), interpolation), config_.min_sigma));
      for (std::size_t c = 0; c < 3; ++c)
        seen.colour[c] = static_cast<std::uint8_t>(std::clamp(colour[c] + 0.5, 0.0, 255.0));
      found_.push_back(seen);
    }
  }
  return true;
}

bool MeshObservations::collectAt(const Mesh& mesh, int finest) {
  found_.clear();
  for (const auto& t : mesh.triangles)
    if (isUsableInPlan(mesh, t) && !observe(mesh, t, finest)) return false;
  return true;
}

std::span<const CellObservation> MeshObservations::collect(const Mesh& mesh) {
  double area2 = 0;
  std::size_t triangles = 0;
  skipped_ = 0;
  for (const auto& t : mesh.triangles) {
    if (!isUsableInPlan(mesh, t)) {
      ++skipped_;
      continue;
    }
    area2 += std::abs(PlanTriangle(mesh, t).area2);
    ++triangles;
  }
  found_.clear();
  if (triangles == 0) return {};
  // A triangulated surface has two triangles a point: each point has the area of two.
  int finest = levelFor(std::sqrt(area2 / static_cast<double>(triangles)));
  while (!collectAt(mesh, finest)) {
    if (finest == 0) {
      found_.clear();  // more cells of the coarsest level than any stereo mesh has
      return {};
    }
    --finest;
  }
  // One observation a cell: of equal heights (a shared edge) the same one whatever the order of triangles.
  const auto order = [](const CellObservation& o) {
    return std::make_tuple(o.place, o.height, -static_cast<int>(o.weight), o.colour);
  };
  std::sort(found_.begin(), found_.end(),
            [&](const CellObservation& a, const CellObservation& b) { return order(a) < order(b); });
  found_.erase(
      std::unique(found_.begin(), found_.end(),
                  [](const CellObservation& a, const CellObservation& b) { return a.place == b.place; }),
      found_.end());
  return found_;
}

}  // namespace fathom::fusion
