#include "recon/fusion/quadtree_map.hpp"

#include <algorithm>
#include <cmath>

#include "recon/fusion/quadtree_impl.hpp"

namespace fathom::fusion {
namespace {

using Node = QuadtreeStore::Node;
constexpr int kCells = QuadtreeStore::kCells;

// Farther from nav's origin than any mission goes [m]; keeps lattice indices well inside the key's 28 bits.
constexpr float kMaxCoordinate = 1e5F;
// A triangle so thin in plan (a wall, or nearly) covers no node: area over its longest edge squared.
constexpr double kThinnest = 1e-6;
// Longest edge whose nodes are looked at, in tiles of the coarsest level: more is no stereo mesh.
constexpr double kMaxEdgeTiles = 4;
// Height error of a flat triangle, per metre of its size: seafloor between the points is interpolated, not
// seen.
constexpr double kInterpolationError = 0.05;
// Sideways error of poses and points, in node spacings: on a 45 degree slope it changes a node's height by as
// much.
constexpr float kSidewaysError = 0.5F;
// Votes that replace even the best-known node: the seafloor there has changed.
constexpr int kMaxVotes = 5;
constexpr Rgb kNoColour = {128, 128, 128};

// A triangle in plan: x north, y east.
struct PlanTriangle {
  std::array<Eigen::Vector2d, 3> corner;
  double area2 = 0;  // twice the signed area [m^2]
  double longest_edge = 0;
  Eigen::Vector2d low, high;

  explicit PlanTriangle(const Mesh& mesh, const std::array<std::uint32_t, 3>& t) {
    for (std::size_t k = 0; k < 3; ++k) corner[k] = mesh.vertices[t[k]].head<2>().cast<double>();
    const Eigen::Vector2d u = corner[1] - corner[0], v = corner[2] - corner[0];
    area2 = u.x() * v.y() - u.y() * v.x();
    longest_edge = std::max({u.norm(), v.norm(), (corner[2] - corner[1]).norm()});
    low = corner[0].cwiseMin(corner[1]).cwiseMin(corner[2]);
    high = corner[0].cwiseMax(corner[1]).cwiseMax(corner[2]);
  }

  // Barycentric weights of a point; false outside. Nodes on an edge belong to both triangles.
  bool weights(const Eigen::Vector2d& p, std::array<double, 3>& w) const {
    constexpr double kEdge = -1e-9;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector2d a = corner[(k + 1) % 3] - p, b = corner[(k + 2) % 3] - p;
      w[k] = (a.x() * b.y() - a.y() * b.x()) / area2;
      if (w[k] < kEdge) return false;
    }
    return true;
  }
};

bool usable(const Mesh& mesh, const std::array<std::uint32_t, 3>& t) {
  for (const std::uint32_t v : t) {
    if (v >= mesh.vertices.size()) return false;
    const Eigen::Vector3f& p = mesh.vertices[v];
    if (!p.allFinite() || p.cwiseAbs().maxCoeff() > kMaxCoordinate) return false;
    if (!mesh.sigma.empty() && !(mesh.sigma[v] >= 0 && std::isfinite(mesh.sigma[v]))) return false;
  }
  return true;
}

// Calls visit(gi, gj, weights) for every node of a lattice under the triangle, indices within [lo, hi] per
// axis.
template <typename Visit>
void nodesUnder(const PlanTriangle& triangle, double spacing, const std::array<std::int64_t, 4>& limits,
                Visit&& visit) {
  const auto first = [&](double x, std::int64_t lo) {
    return std::max(lo, static_cast<std::int64_t>(std::ceil(x / spacing - 1e-9)));
  };
  const auto last = [&](double x, std::int64_t hi) {
    return std::min(hi, static_cast<std::int64_t>(std::floor(x / spacing + 1e-9)));
  };
  const std::int64_t i1 = last(triangle.high.x(), limits[1]);
  const std::int64_t j0 = first(triangle.low.y(), limits[2]), j1 = last(triangle.high.y(), limits[3]);
  std::array<double, 3> w;
  for (std::int64_t i = first(triangle.low.x(), limits[0]); i <= i1; ++i) {
    for (std::int64_t j = j0; j <= j1; ++j) {
      const Eigen::Vector2d p(static_cast<double>(i) * spacing, static_cast<double>(j) * spacing);
      if (triangle.weights(p, w)) visit(i, j, w);
    }
  }
}

constexpr std::array<std::int64_t, 4> kNoLimits = {-(std::int64_t{1} << 40), std::int64_t{1} << 40,
                                                   -(std::int64_t{1} << 40), std::int64_t{1} << 40};

// Gives a node its pending observation. True if the observation disagreed.
bool observe(Node& node, float spacing, double gate) {
  const float w = 1.0F / (node.pending_sigma * node.pending_sigma);
  const float residual = node.pending_depth - node.depth;
  const bool known = node.seen();
  bool disagrees = false;
  if (known) {
    const float sideways = kSidewaysError * spacing;
    const float variance = 1.0F / w + (1.0F + node.scatter) / node.information + sideways * sideways;
    disagrees = residual * residual > static_cast<float>(gate * gate) * variance;
  }
  if (disagrees && ++node.disagreements <= std::min<int>(node.count, kMaxVotes)) return true;
  if (!known || disagrees) {
    node.depth = node.pending_depth;
    node.information = w;
    node.scatter = 0;
    node.count = 1;
    node.disagreements = 0;
    for (std::size_t c = 0; c < 3; ++c)
      node.colour[c] = static_cast<std::uint16_t>(node.pending_colour[c] * 256);
    return disagrees;
  }
  node.information += w;
  const float share = w / node.information;
  node.depth += share * residual;
  node.scatter += w * residual * (node.pending_depth - node.depth);
  for (std::size_t c = 0; c < 3; ++c) {
    const float old = node.colour[c];
    node.colour[c] = static_cast<std::uint16_t>(
        std::lround(old + share * (static_cast<float>(node.pending_colour[c]) * 256.0F - old)));
  }
  if (node.count < 255) ++node.count;
  if (node.disagreements > 0) --node.disagreements;
  return false;
}

}  // namespace

int QuadtreeMap::Impl::levelFor(double point_spacing) const {
  const double wanted = store.config().node_spacing_ratio * point_spacing;
  int level = 0;
  while (level < store.config().max_level && store.spacing(level + 1) >= wanted) ++level;
  return level;
}

// Makes the leaves that the mesh needs, finest first: a triangle asks for the level of the mesh's mean point
// spacing, or coarser where the triangle itself is that much larger.
void QuadtreeMap::Impl::makeLeaves(const Mesh& mesh) {
  double area2 = 0;
  std::size_t triangles = 0;
  for (const auto& t : mesh.triangles) {
    if (!usable(mesh, t)) continue;
    area2 += std::abs(PlanTriangle(mesh, t).area2);
    ++triangles;
  }
  if (triangles == 0) return;
  // A triangulated surface has two triangles a point: each point stands for the area of two.
  const double mean_spacing = std::sqrt(area2 / static_cast<double>(triangles));
  const int finest = levelFor(mean_spacing);
  for (int level = finest; level >= 0; --level) {
    for (const auto& t : mesh.triangles) {
      if (!usable(mesh, t)) continue;
      const PlanTriangle triangle(mesh, t);
      if (!covers(triangle.area2, triangle.longest_edge)) continue;
      // Half of the triangle's own spacing, so that only clearly sparse places are coarser than the mesh.
      if (std::min(finest, levelFor(0.5 * std::sqrt(std::abs(triangle.area2)))) != level) continue;
      nodesUnder(triangle, store.spacing(level), kNoLimits,
                 [&](std::int64_t gi, std::int64_t gj, const std::array<double, 3>&) {
                   if (!store.ensure(level, gi, gj, now)) ++refused;
                 });
    }
  }
}

bool QuadtreeMap::Impl::covers(double area2, double longest_edge) const {
  return std::abs(area2) > kThinnest * longest_edge * longest_edge &&
         longest_edge < kMaxEdgeTiles * store.tileSize(0);
}

// Notes the triangle's observation at every node under it of the leaves below `key`; where surfaces lie over
// one another the upper one, which the camera saw, wins.
void QuadtreeMap::Impl::note(const TileKey& key, const Mesh& mesh, const std::array<std::uint32_t, 3>& t) {
  const PlanTriangle triangle(mesh, t);
  const double size = store.tileSize(key.level);
  const double north0 = key.north_index * size, east0 = key.east_index * size;
  if (triangle.high.x() < north0 || triangle.low.x() > north0 + size || triangle.high.y() < east0 ||
      triangle.low.y() > east0 + size)
    return;
  const std::int32_t found = store.find(key);
  if (found == TileIndex::kAbsent) return;
  if (found == TileIndex::kInner) {
    for (int c = 0; c < 4; ++c) note(QuadtreeStore::child(key, c / 2, c % 2), mesh, t);
    return;
  }
  const std::int64_t i0 = static_cast<std::int64_t>(key.north_index) * kCells;
  const std::int64_t j0 = static_cast<std::int64_t>(key.east_index) * kCells;
  const double interpolation = kInterpolationError * std::sqrt(std::abs(triangle.area2));
  QuadtreeStore::Nodes& nodes = store.nodes(found);
  nodesUnder(triangle, store.spacing(key.level), {i0, i0 + kCells - 1, j0, j0 + kCells - 1},
             [&](std::int64_t gi, std::int64_t gj, const std::array<double, 3>& w) {
               double depth = 0, sigma = 0;
               std::array<double, 3> colour{};
               for (std::size_t k = 0; k < 3; ++k) {
                 depth += w[k] * static_cast<double>(mesh.vertices[t[k]].z());
                 if (!mesh.sigma.empty()) sigma += w[k] * static_cast<double>(mesh.sigma[t[k]]);
                 const Rgb rgb = mesh.colours.empty() ? kNoColour : mesh.colours[t[k]];
                 for (std::size_t c = 0; c < 3; ++c) colour[c] += w[k] * rgb[c];
               }
               Node& node = nodes[static_cast<std::size_t>((gi - i0) * kCells + gj - j0)];
               if (node.pending_sigma > 0 && node.pending_depth <= static_cast<float>(depth)) return;
               sigma = std::max(sigma, store.config().min_sigma);
               node.pending_depth = static_cast<float>(depth);
               node.pending_sigma = static_cast<float>(std::hypot(sigma, interpolation));
               for (std::size_t c = 0; c < 3; ++c)
                 node.pending_colour[c] = static_cast<std::uint8_t>(std::clamp(colour[c] + 0.5, 0.0, 255.0));
               QuadtreeStore::Leaf& leaf = store.leaf(found);
               if (!leaf.touched) {
                 leaf.touched = true;
                 touched.push_back(found);  // capacity: all tiles
               }
             });
}

// Gives every pending observation to its node and marks what changed; a tile whose neighbour's first row or
// column changed has changed too, for it shows them as its last.
std::size_t QuadtreeMap::Impl::takeObservations() {
  std::size_t updated = 0;
  for (const std::int32_t slot : touched) {
    QuadtreeStore::Leaf& leaf = store.leaf(slot);
    leaf.touched = false;
    leaf.observed = leaf.revision = now;
    const int level = leaf.key.level;
    const auto spacing = static_cast<float>(store.spacing(level));
    const std::int64_t i0 = static_cast<std::int64_t>(leaf.key.north_index) * kCells;
    const std::int64_t j0 = static_cast<std::int64_t>(leaf.key.east_index) * kCells;
    QuadtreeStore::Nodes& nodes = store.nodes(slot);
    for (int k = 0; k < kCells * kCells; ++k) {
      Node& node = nodes[static_cast<std::size_t>(k)];
      if (!(node.pending_sigma > 0)) continue;
      if (observe(node, spacing, store.config().gate)) ++outvoted;
      node.pending_sigma = 0;
      ++updated;
      const int i = k / kCells, j = k % kCells;
      for (int d = -1; d <= 0; ++d) {
        if (i == 0) markChanged(level, i0 - 1, j0 + j + d);
        if (j == 0) markChanged(level, i0 + i + d, j0 - 1);
      }
    }
  }
  touched.clear();
  return updated;
}

void QuadtreeMap::Impl::markChanged(int level, std::int64_t gi, std::int64_t gj) {
  // Of finer neighbours the one along the shared edge, at the far end of the lattice cell.
  const int down = store.config().max_level - level;
  const std::int64_t far = (std::int64_t{1} << down) - 1;
  const std::int32_t slot = store.leafAt(store.config().max_level, (gi << down) + far, (gj << down) + far);
  if (slot != QuadtreeStore::kNone) store.leaf(slot).revision = now;
}

QuadtreeMap::QuadtreeMap(const QuadtreeConfig& config) : impl_(std::make_unique<Impl>(config)) {}
QuadtreeMap::~QuadtreeMap() = default;

std::size_t QuadtreeMap::fuse(const Mesh& mesh) {
  Impl& map = *impl_;
  ++map.now;
  map.makeLeaves(mesh);
  const double root = map.store.tileSize(0);
  for (const auto& t : mesh.triangles) {
    if (!usable(mesh, t)) {
      ++map.skipped_triangles;
      continue;
    }
    const PlanTriangle triangle(mesh, t);
    if (!map.covers(triangle.area2, triangle.longest_edge)) continue;
    const auto tile = [&](double x) { return static_cast<std::int32_t>(std::floor(x / root)); };
    for (std::int32_t n = tile(triangle.low.x()); n <= tile(triangle.high.x()); ++n)
      for (std::int32_t e = tile(triangle.low.y()); e <= tile(triangle.high.y()); ++e)
        map.note({n, e, 0}, mesh, t);
  }
  const std::size_t updated = map.takeObservations();
  map.observations += updated;
  return updated;
}

void QuadtreeMap::clear(std::uint32_t fused) {
  Impl& map = *impl_;
  map.store.clear();
  map.touched.clear();
  map.now = fused;
  map.observations = map.outvoted = map.refused = map.skipped_triangles = 0;
}

std::uint32_t QuadtreeMap::fused() const {
  return impl_->now;
}

QuadtreeMap::Counters QuadtreeMap::counters() const {
  const Impl& map = *impl_;
  Counters out;
  out.observations = map.observations;
  out.outvoted = map.outvoted;
  out.coarsened = map.store.coarsened();
  out.refused = map.refused;
  out.skipped_triangles = map.skipped_triangles;
  out.tiles_used = map.store.used();
  out.tiles_high_water = map.store.highWater();
  out.memory_bytes = map.store.memoryBytes() + sizeof(Impl) +
                     (map.touched.capacity() + map.order.capacity()) * sizeof(std::int32_t);
  return out;
}

}  // namespace fathom::fusion
