#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "recon/fusion/quadtree_impl.hpp"

namespace fathom::fusion {
namespace {

using Node = QuadtreeStore::Node;
constexpr int kCells = QuadtreeStore::kCells;
constexpr int kSide = HeightTile::kSide;

HeightTile::Node shown(const Node& node) {
  HeightTile::Node out;
  if (!node.seen()) return out;
  out.depth = node.depth;
  out.sigma = std::sqrt(node.variance());
  out.coverage = 1;
  out.colour = node.rgb();
  return out;
}

// Means of the leaves' nodes under a tent as wide as a coarse tile's spacing, each node weighted by the area
// that it stands for: on an even slope without bias.
class TentMean {
 public:
  TentMean(const QuadtreeStore& store, const TileKey& key) : store_(store), key_(key) {}

  void add(const TileKey& below, std::uint32_t& revision) {
    const double size = store_.tileSize(below.level), spacing = store_.spacing(key_.level);
    const double north0 = key_.north_index * store_.tileSize(key_.level);
    const double east0 = key_.east_index * store_.tileSize(key_.level);
    const double north = below.north_index * size, east = below.east_index * size;
    const double reach = store_.tileSize(key_.level) + spacing;
    if (north >= north0 + reach || north + size <= north0 - spacing || east >= east0 + reach ||
        east + size <= east0 - spacing)
      return;
    const std::int32_t found = store_.find(below);
    if (found == TileIndex::kAbsent) return;
    if (found == TileIndex::kInner) {
      for (int c = 0; c < 4; ++c) add(QuadtreeStore::child(below, c / 2, c % 2), revision);
      return;
    }
    if (below.level <= key_.level) return;  // coarser neighbours: see extract()
    revision = std::max(revision, store_.leaf(found).revision);
    const double step = store_.spacing(below.level) / spacing;
    const QuadtreeStore::Nodes& nodes = store_.nodes(found);
    for (int k = 0; k < kCells * kCells; ++k) {
      const Node& node = nodes[static_cast<std::size_t>(k)];
      if (!node.seen()) continue;
      const double x = (north - north0) / spacing + (k / kCells) * step;
      const double y = (east - east0) / spacing + (k % kCells) * step;
      const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
      for (int c = 0; c < 4; ++c) {
        const int ti = i + c / 2, tj = j + c % 2;
        if (ti < 0 || ti >= kSide || tj < 0 || tj >= kSide) continue;
        const double tent = (1 - std::abs(x - ti)) * (1 - std::abs(y - tj)) * step * step;
        if (tent > 0) addTo(sums_[static_cast<std::size_t>(ti * kSide + tj)], node, tent);
      }
    }
  }

  [[nodiscard]] HeightTile::Node node(int i, int j) const {
    const Sum& sum = sums_[static_cast<std::size_t>(i * kSide + j)];
    HeightTile::Node out;
    if (sum.area <= 0) return out;
    out.depth = static_cast<float>(sum.depth / sum.area);
    out.sigma = static_cast<float>(std::sqrt(sum.variance) / sum.area);
    out.coverage = static_cast<float>(std::min(1.0, sum.area));  // a whole tent has area 1
    for (std::size_t c = 0; c < 3; ++c)
      out.colour[c] = static_cast<std::uint8_t>(sum.colour[c] / sum.area + 0.5);
    return out;
  }

 private:
  struct Sum {
    double area = 0, depth = 0, variance = 0;
    std::array<double, 3> colour{};
  };

  static void addTo(Sum& sum, const Node& node, double tent) {
    sum.area += tent;
    sum.depth += tent * static_cast<double>(node.depth);
    sum.variance += tent * tent * static_cast<double>(node.variance());
    const Rgb rgb = node.rgb();
    for (std::size_t c = 0; c < 3; ++c) sum.colour[c] += tent * rgb[c];
  }

  const QuadtreeStore& store_;
  TileKey key_;
  std::array<Sum, kSide * kSide> sums_{};
};

}  // namespace

const std::vector<std::int32_t>& QuadtreeMap::Impl::leavesInOrder() {
  if (order_of_shape != store.shapeChanges()) {
    order.clear();
    for (std::size_t slot = 0; slot < store.leaves().size(); ++slot)
      if (store.leaves()[slot].used) order.push_back(static_cast<std::int32_t>(slot));
    std::sort(order.begin(), order.end(), [this](std::int32_t a, std::int32_t b) {
      return TileIndex::pack(store.leaf(a).key) < TileIndex::pack(store.leaf(b).key);
    });
    order_of_shape = store.shapeChanges();
  }
  return order;
}

void QuadtreeMap::forEachLeaf(const std::function<void(const TileKey&, std::uint32_t)>& visit) const {
  for (const std::int32_t slot : impl_->leavesInOrder()) {
    const QuadtreeStore::Leaf& leaf = impl_->store.leaf(slot);
    visit(leaf.key, leaf.revision);
  }
}

bool QuadtreeMap::extract(const TileKey& key, HeightTile& out) const {
  const QuadtreeStore& store = impl_->store;
  if (key.level < 0 || key.level > store.config().max_level) return false;
  const std::int32_t found = store.find(key);
  if (found == TileIndex::kAbsent) return false;
  out.north_index = key.north_index;
  out.east_index = key.east_index;
  out.level = key.level;
  out.size = store.tileSize(key.level);
  bool any = false;
  const std::int64_t i0 = static_cast<std::int64_t>(key.north_index) * kCells;
  const std::int64_t j0 = static_cast<std::int64_t>(key.east_index) * kCells;
  if (found >= 0) {
    out.revision = store.leaf(found).revision;
    for (int i = 0; i < kSide; ++i) {
      for (int j = 0; j < kSide; ++j) {
        const bool own = i < kCells && j < kCells;
        out.at(i, j) = shown(own ? store.nodes(found)[static_cast<std::size_t>(i * kCells + j)]
                                 : store.sample(key.level, i0 + i, j0 + j));
        any = any || (own && out.at(i, j).coverage > 0);
      }
    }
    return any;
  }
  TentMean mean(store, key);
  out.revision = 0;
  for (int n = -1; n <= 1; ++n)
    for (int e = -1; e <= 1; ++e)
      mean.add({key.north_index + n, key.east_index + e, key.level}, out.revision);
  for (int i = 0; i < kSide; ++i) {
    for (int j = 0; j < kSide; ++j) {
      out.at(i, j) = mean.node(i, j);
      // Beyond the tile's own nodes a neighbour may be no finer than the tile itself.
      if ((i == kCells || j == kCells) && out.at(i, j).coverage <= 0)
        out.at(i, j) = shown(store.sample(key.level, i0 + i, j0 + j));
      any = any || out.at(i, j).coverage > 0;
    }
  }
  return any;
}

Mesh toMesh(const QuadtreeMap& map) {
  Mesh all;
  Mesh tile_mesh;
  HeightTile tile;
  // Tiles share nodes at the same place: its lattice index in a level finer than any map has.
  constexpr double kUnitsPerRoot = kCells << 12;
  struct PlaceHash {
    std::size_t operator()(const std::array<std::int64_t, 2>& p) const {
      return static_cast<std::size_t>(p[0]) * 0x9e3779b97f4a7c15ULL + static_cast<std::size_t>(p[1]);
    }
  };
  std::unordered_map<std::array<std::int64_t, 2>, std::uint32_t, PlaceHash> vertex_at;
  std::vector<std::uint32_t> joined;
  map.forEachLeaf([&](const TileKey& key, std::uint32_t) {
    if (!map.extract(key, tile)) return;
    tile_mesh = Mesh{};
    appendTile(tile_mesh, tile);
    joined.clear();
    const double unit = tile.size * (1 << key.level) / kUnitsPerRoot;
    for (std::size_t v = 0; v < tile_mesh.vertices.size(); ++v) {
      const Eigen::Vector3f& p = tile_mesh.vertices[v];
      const auto [at, is_new] = vertex_at.try_emplace(
          {std::llround(static_cast<double>(p.x()) / unit), std::llround(static_cast<double>(p.y()) / unit)},
          static_cast<std::uint32_t>(all.vertices.size()));
      joined.push_back(at->second);
      if (!is_new) continue;
      all.vertices.push_back(p);
      all.colours.push_back(tile_mesh.colours[v]);
      all.sigma.push_back(tile_mesh.sigma[v]);
    }
    for (const auto& [a, b, c] : tile_mesh.triangles)
      all.triangles.push_back({joined[a], joined[b], joined[c]});
  });
  computeNormals(all);
  return all;
}

}  // namespace fathom::fusion
