#include "recon/fusion/quadtree_map.hpp"

#include <algorithm>
#include <unordered_map>
#include <vector>

#include "recon/fusion/quadtree_store.hpp"

namespace fathom::fusion {
namespace {

// Side of a tile towards its neighbour at (north, east), as numbered in QuadtreeStore::Tile::edge.
bool touches(int side, int north, int east) {
  switch (side) {
    case 0:
      return north > 0;  // the south edge of a neighbour to the north
    case 1:
      return north < 0;
    case 2:
      return east > 0;
    default:
      return east < 0;
  }
}

// Last change at the facing edges of the square and of all squares below it there.
std::uint32_t changedTowards(const QuadtreeStore& store, const TileKey& key, int north, int east) {
  const std::int32_t found = store.index().find(key);
  if (found == TileIndex::kAbsent) return 0;
  std::uint32_t last = 0;
  if (found >= 0) {
    const QuadtreeStore::Tile& tile = store.tile(found);
    last = tile.changed;
    for (int side = 0; side < 4; ++side)
      if (touches(side, north, east)) last = std::min(last, tile.edge[static_cast<std::size_t>(side)]);
  }
  if (store.index().below(key) == 0) return last;
  for (int c = 0; c < 4; ++c) {
    if ((north != 0 && (c / 2 == 0) != (north > 0)) || (east != 0 && (c % 2 == 0) != (east > 0))) continue;
    last = std::max(last, changedTowards(store, TileIndex::child(key, c), north, east));
  }
  return last;
}

constexpr int kFinest = 12;  // no map has a finer level
constexpr std::uint32_t kUnseen = 0xFFFFFFFF;

// Nodes by their place, in spacings of level kFinest, and the cells between them. A cell that has finer
// neighbours is a fan about its middle, so that no vertex is on the inside of another triangle's edge.
class StitchedMesh {
 public:
  // Leaves come coarse first: where levels meet, the finer one's node is kept.
  void addNodes(const HeightTile& tile) {
    finest_ = std::max<int>(finest_, tile.level);
    const std::int64_t step = stepOf(tile.level);
    for (int i = 0; i < HeightTile::kSide; ++i) {
      for (int j = 0; j < HeightTile::kSide; ++j) {
        const HeightTile::Node& node = tile.at(i, j);
        if (node.coverage <= 0) continue;
        const Place place = placeOf(tile, step, i, j);
        const auto [at, is_new] =
            nodes_.try_emplace(place, static_cast<std::uint32_t>(mesh_.vertices.size()));
        if (is_new) {
          mesh_.vertices.emplace_back(static_cast<float>(tile.north0() + i * tile.spacing()),
                                      static_cast<float>(tile.east0() + j * tile.spacing()), node.depth);
          mesh_.colours.push_back(node.colour);
          mesh_.sigma.push_back(node.sigma);
        } else {
          mesh_.vertices[at->second].z() = node.depth;
          mesh_.colours[at->second] = node.colour;
          mesh_.sigma[at->second] = node.sigma;
        }
      }
    }
  }

  void addCells(const TileKey& key) {
    const std::int64_t step = stepOf(key.level);
    for (int i = 0; i < kTileCells; ++i) {
      for (int j = 0; j < kTileCells; ++j) {
        const Place low = {(std::int64_t{key.north_index} * kTileCells + i) * step,
                           (std::int64_t{key.east_index} * kTileCells + j) * step};
        addCell(low, step, {j == 0, i == kTileCells - 1, j == kTileCells - 1, i == 0});
      }
    }
  }

  // Without the nodes that no triangle has.
  Mesh take() {
    std::vector<std::uint32_t> renamed(mesh_.vertices.size(), kUnseen);
    Mesh out;
    for (auto& triangle : mesh_.triangles) {
      for (std::uint32_t& v : triangle) {
        if (renamed[v] == kUnseen) {
          renamed[v] = static_cast<std::uint32_t>(out.vertices.size());
          out.vertices.push_back(mesh_.vertices[v]);
          out.colours.push_back(mesh_.colours[v]);
          out.sigma.push_back(mesh_.sigma[v]);
        }
        v = renamed[v];
      }
    }
    out.triangles = std::move(mesh_.triangles);
    computeNormals(out);
    return out;
  }

 private:
  using Place = std::array<std::int64_t, 2>;
  struct PlaceHash {
    std::size_t operator()(const Place& p) const {
      return static_cast<std::size_t>(p[0]) * 0x9e3779b97f4a7c15ULL + static_cast<std::size_t>(p[1]);
    }
  };

  static std::int64_t stepOf(int level) { return std::int64_t{1} << (kFinest - level); }
  static Place placeOf(const HeightTile& tile, std::int64_t step, int i, int j) {
    return {(std::int64_t{tile.north_index} * kTileCells + i) * step,
            (std::int64_t{tile.east_index} * kTileCells + j) * step};
  }
  [[nodiscard]] std::uint32_t nodeAt(const Place& place) const {
    const auto found = nodes_.find(place);
    return found == nodes_.end() ? kUnseen : found->second;
  }

  // `at_border`: sides (west, north, east, south) on the tile's border.
  void addCell(const Place& low, std::int64_t step, const std::array<bool, 4>& at_border) {
    // Counter-clockwise seen from above (from negative z, where north x east points down).
    const std::array<Place, 4> corner = {low, Place{low[0], low[1] + step},
                                         Place{low[0] + step, low[1] + step}, Place{low[0] + step, low[1]}};
    constexpr std::array<std::size_t, 4> kSideAfter = {3, 2, 1, 0};  // south, east, north, west
    border_.clear();
    std::size_t corners = 0;
    Eigen::Vector3d middle = Eigen::Vector3d::Zero(), colour = Eigen::Vector3d::Zero();
    double sigma = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::uint32_t node = nodeAt(corner[k]);
      if (node == kUnseen) continue;
      ++corners;
      border_.push_back(node);
      middle += mesh_.vertices[node].cast<double>();
      for (int c = 0; c < 3; ++c) colour[c] += mesh_.colours[node][static_cast<std::size_t>(c)];
      sigma += static_cast<double>(mesh_.sigma[node]);
      const std::size_t next = (k + 1) % 4;
      if (at_border[kSideAfter[k]] && nodeAt(corner[next]) != kUnseen)
        addFiner(corner[k], corner[next], step);
    }
    if (corners < 3) return;
    if (border_.size() == corners) {
      mesh_.triangles.push_back({border_[0], border_[1], border_[2]});
      if (corners == 4) mesh_.triangles.push_back({border_[0], border_[2], border_[3]});
      return;
    }
    const double share = 1.0 / static_cast<double>(corners);
    const auto fan = static_cast<std::uint32_t>(mesh_.vertices.size());
    mesh_.vertices.emplace_back((middle * share).cast<float>());
    mesh_.colours.push_back({static_cast<std::uint8_t>(colour[0] * share + 0.5),
                             static_cast<std::uint8_t>(colour[1] * share + 0.5),
                             static_cast<std::uint8_t>(colour[2] * share + 0.5)});
    mesh_.sigma.push_back(static_cast<float>(sigma * share));
    for (std::size_t k = 0; k < border_.size(); ++k)
      mesh_.triangles.push_back({border_[k], border_[(k + 1) % border_.size()], fan});
  }

  // Nodes of finer neighbours strictly between two corners.
  void addFiner(const Place& from, const Place& to, std::int64_t step) {
    const std::int64_t finer = stepOf(finest_);
    const std::array<std::int64_t, 2> stride = {(to[0] - from[0]) / step, (to[1] - from[1]) / step};
    for (std::int64_t s = finer; s < step; s += finer) {
      const std::uint32_t node = nodeAt({from[0] + stride[0] * s, from[1] + stride[1] * s});
      if (node != kUnseen) border_.push_back(node);
    }
  }

  Mesh mesh_;
  std::unordered_map<Place, std::uint32_t, PlaceHash> nodes_;
  std::vector<std::uint32_t> border_;  // of a cell
  int finest_ = 0;
};

}  // namespace

QuadtreeMap::QuadtreeMap(const QuadtreeConfig& config) : impl_(std::make_unique<Impl>(config)) {}
QuadtreeMap::~QuadtreeMap() = default;

std::size_t QuadtreeMap::fuse(const Mesh& mesh) {
  Impl& map = *impl_;
  ++map.now;
  const std::span<const CellObservation> seen = map.seen.collect(mesh);
  map.skipped_triangles += map.seen.skippedTriangles();
  if (!map.store.add(seen, map.now)) {
    ++map.refused;
    return 0;
  }
  map.observations += seen.size();
  return seen.size();
}

std::size_t QuadtreeMap::remove(const Mesh& mesh) {
  Impl& map = *impl_;
  ++map.now;
  const std::span<const CellObservation> seen = map.seen.collect(mesh);
  map.store.subtract(seen, map.now);
  map.removed += seen.size();
  return seen.size();
}

bool QuadtreeMap::coarsen(const TileKey& key) {
  if (!impl_->store.canCoarsen(key)) return false;
  impl_->store.coarsen(key, ++impl_->now);
  return true;
}

void QuadtreeMap::noteVehicle(const Eigen::Vector2d& north_east) {
  impl_->store.noteVehicle(north_east);
}

void QuadtreeMap::noteSent(const TileKey& key) {
  impl_->store.noteSent(key);
}

void QuadtreeMap::clear(std::uint32_t fused) {
  Impl& map = *impl_;
  map.store.clear();
  map.now = fused;
  map.observations = map.removed = map.refused = map.skipped_triangles = 0;
}

std::uint32_t QuadtreeMap::fused() const {
  return impl_->now;
}

std::string QuadtreeMap::canonicalBytes() const {
  const QuadtreeStore& store = impl_->store;
  std::vector<std::pair<std::uint64_t, std::int32_t>> tiles;
  store.index().forEach([&](const TileKey& key, std::int32_t slot) {
    if (slot >= 0) tiles.emplace_back(TileIndex::pack(key), slot);
  });
  std::sort(tiles.begin(), tiles.end());
  std::string bytes;
  const auto put = [&](const auto& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (const auto& [key, slot] : tiles) {
    put(key);
    put(store.tile(slot).closed);
    for (int cell = 0; cell < QuadtreeStore::kCells * QuadtreeStore::kCells; ++cell) {
      for (std::int32_t k = store.head(slot, cell); k != QuadtreeStore::kNone; k = store.layer(k).next) {
        put(cell);
        put(store.layer(k).bin);
        put(store.layer(k).sums);
      }
    }
  }
  return bytes;
}

QuadtreeMap::Counters QuadtreeMap::counters() const {
  const Impl& map = *impl_;
  const QuadtreeStore::Counters& store = map.store.counters();
  Counters out;
  out.observations = map.observations;
  out.outvoted = store.outvoted;
  out.removed = map.removed;
  out.missing = store.missing;
  out.coarsened = store.coarsened;
  out.refused = map.refused;
  out.skipped_triangles = map.skipped_triangles;
  out.tiles_used = store.tiles;
  out.tiles_high_water = store.tiles_high_water;
  out.layers_used = store.layers;
  out.layers_high_water = store.layers_high_water;
  out.layers = static_cast<int>(map.store.config().max_tiles) * map.store.config().layers_per_tile;
  out.memory_bytes = sizeof(QuadtreeMap) + sizeof(Impl) - sizeof(QuadtreeStore) + map.store.memoryBytes() +
                     map.seen.memoryBytes() + map.leaves.capacity() * sizeof(Impl::Leaf);
  return out;
}

std::uint32_t QuadtreeMap::Impl::revisionOf(const TileKey& key) const {
  std::uint32_t last = 0;
  for (TileKey up = key; up.level > 0;) {
    up = TileIndex::parent(up);
    const std::int32_t found = store.index().find(up);
    if (found >= 0) last = std::max(last, store.tile(found).changed);
  }
  for (int n = -1; n <= 1; ++n)
    for (int e = -1; e <= 1; ++e)
      last =
          std::max(last, changedTowards(store, {key.north_index + n, key.east_index + e, key.level}, n, e));
  return last;
}

void QuadtreeMap::Impl::leavesBelow(const TileKey& key, bool shows_through, int finest) {
  const std::int32_t found = store.index().find(key);
  shows_through = shows_through || found >= 0;
  if (found == TileIndex::kAbsent || store.index().below(key) == 0 || key.level >= finest) {
    if (found != TileIndex::kAbsent || shows_through) leaves.push_back({TileIndex::pack(key), 0});
    return;
  }
  for (int c = 0; c < 4; ++c) leavesBelow(TileIndex::child(key, c), shows_through, finest);
}

void QuadtreeMap::Impl::findLeaves(int finest) {
  leaves.clear();
  store.index().forEach([&](const TileKey& key, std::int32_t) {
    if (key.level == 0) leavesBelow(key, false, finest);
  });
  for (Leaf& leaf : leaves) leaf.revision = revisionOf(TileIndex::unpack(leaf.key));
  std::sort(leaves.begin(), leaves.end(), [](const Leaf& a, const Leaf& b) { return a.key < b.key; });
}

void QuadtreeMap::forEachLeaf(const std::function<void(const TileKey&, std::uint32_t)>& visit) const {
  forEachLeaf(impl_->store.config().max_level, visit);
}

void QuadtreeMap::forEachLeaf(int finest,
                              const std::function<void(const TileKey&, std::uint32_t)>& visit) const {
  impl_->findLeaves(finest);
  for (const Impl::Leaf& leaf : impl_->leaves) visit(TileIndex::unpack(leaf.key), leaf.revision);
}

Mesh meshAt(const QuadtreeMap& map, int level) {
  StitchedMesh stitched;
  std::vector<TileKey> leaves;
  HeightTile tile;
  map.forEachLeaf(level, [&](const TileKey& key, std::uint32_t) {
    if (map.extract(key, tile)) {
      leaves.push_back(key);
      stitched.addNodes(tile);
    }
  });
  for (const TileKey& key : leaves) stitched.addCells(key);
  return stitched.take();
}

Mesh toMesh(const QuadtreeMap& map) {
  return meshAt(map, kFinest);
}

}  // namespace fathom::fusion
