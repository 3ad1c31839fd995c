// The onboard map as saved state. Pools are saved up to their high-water mark, free places included: what is
// free is taken in the same order as before, so that a map that was loaded goes on bit by bit as the one
// that was saved. The index is made anew from the tiles.
#include <algorithm>
#include <cmath>

#include "recon/fusion/quadtree_impl.hpp"
#include "recon/geometry/state_values.hpp"

namespace fathom::fusion {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("QUAD"), kVersion = 1;
// Far beyond the 100 km up to which meshes are fused, and within what the index can name.
constexpr std::int32_t kFarthestIndex = 1 << 26;

template <typename Archive, typename Key>
void exchangeKey(Archive& archive, Key& key) {
  archive(key.north_index, key.east_index, key.level);
}

}  // namespace

template <typename Archive, typename Self>
void QuadtreeStore::exchangeTile(Archive& archive, Self& t) {
  archive(t.used, t.next_free);
  if (!t.used) return;
  exchangeKey(archive, t.key);
  archive(t.closed, t.sent, t.layers, t.seen, t.changed, t.edge, t.relief_of, t.relief);
}

template <typename Archive, typename Self>
void QuadtreeStore::exchange(Archive& archive, Self& self) {
  archive(self.counters_, self.shape_changes_, self.free_tile_, self.free_layer_, self.vehicle_);
  const auto tiles = static_cast<std::size_t>(self.counters_.tiles_high_water);
  const auto layers = static_cast<std::size_t>(self.counters_.layers_high_water);
  archive.require(self.counters_.tiles_high_water >= 0 && tiles <= self.tiles_.size() &&
                      self.counters_.layers_high_water >= 0 && layers <= self.layers_.size(),
                  "the map's pools have another size");
  std::uint64_t relief_next = self.relief_next_, candidates = self.candidates_left_;
  archive(relief_next, candidates);
  archive.require(relief_next < self.tiles_.size() && candidates <= self.tiles_.size(), "a place too far");
  if constexpr (Archive::kLoading) {
    if (!archive.ok()) return;
    self.relief_next_ = relief_next;
    self.candidates_.resize(candidates);
    self.candidates_left_ = candidates;
  }
  // Those that are used before all are compared anew: the last ones.
  for (std::size_t k = self.candidates_.size() - self.candidates_left_; k < self.candidates_.size(); ++k) {
    exchangeKey(archive, self.candidates_[k].parent);
    archive(self.candidates_[k].changed, self.candidates_[k].value);
  }
  for (std::size_t k = 0; k < tiles; ++k) {
    exchangeTile(archive, self.tiles_[k]);
    if (self.tiles_[k].used) archive(self.heads_[k]);
  }
  archive.elements(self.layers_.data(), layers);
}

void QuadtreeStore::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool QuadtreeStore::load(rt::StateReader& reader) {
  clear();
  exchange(reader, *this);
  if (reader.ok() && !(loadIndex() && tilesAreWhole() && layersAreWhole()))
    reader.fail("the map contradicts itself");
  if (!reader.ok()) clear();
  return reader.ok();
}

bool QuadtreeStore::isNameable(const TileKey& key) const {
  return key.level >= 0 && key.level <= config_.max_level && std::abs(key.north_index) <= kFarthestIndex &&
         std::abs(key.east_index) <= kFarthestIndex;
}

// Every square once, in the index.
bool QuadtreeStore::loadIndex() {
  for (std::size_t k = 0; k < candidates_.size(); ++k)
    if (!isNameable(candidates_[k].parent) || candidates_[k].parent.level >= config_.max_level) return false;
  for (std::size_t k = 0; k < tiles_.size(); ++k) {
    const Tile& t = tiles_[k];
    if (!t.used) continue;
    const bool fits = isNameable(t.key) && index_.room() > static_cast<std::size_t>(config_.max_level);
    if (!fits || index_.find(t.key) >= 0) return false;
    index_.set(t.key, static_cast<std::int32_t>(k));
  }
  return true;
}

// Free tiles and those in use are all there are, each once.
bool QuadtreeStore::tilesAreWhole() const {
  std::vector<bool> met(tiles_.size());
  std::size_t used = 0, free = 0;
  for (std::size_t k = 0; k < tiles_.size(); ++k) {
    met[k] = tiles_[k].used;
    used += met[k] ? 1 : 0;
  }
  for (std::int32_t k = free_tile_; k != kNone; k = tiles_[static_cast<std::size_t>(k)].next_free, ++free) {
    if (k < 0 || static_cast<std::size_t>(k) >= tiles_.size() || met[static_cast<std::size_t>(k)])
      return false;
    met[static_cast<std::size_t>(k)] = true;
  }
  return used == static_cast<std::size_t>(counters_.tiles) && used + free == tiles_.size();
}

// The same of layers; and those of a cell lie in order.
bool QuadtreeStore::layersAreWhole() const {
  std::vector<bool> met(layers_.size());
  const auto meet = [&](std::int32_t k) {
    if (k < 0 || static_cast<std::size_t>(k) >= layers_.size() || met[static_cast<std::size_t>(k)])
      return false;
    met[static_cast<std::size_t>(k)] = true;
    return true;
  };
  std::size_t used = 0, free = 0;
  for (std::size_t slot = 0; slot < tiles_.size(); ++slot) {
    if (!tiles_[slot].used) continue;
    std::size_t in_tile = 0;
    for (const std::int32_t head : heads_[slot]) {
      std::int32_t before = kNone;
      for (std::int32_t k = head; k != kNone; before = k, k = layer(k).next, ++in_tile) {
        if (!meet(k) || layer(k).sums.count() == 0 || layer(k).sums.weight() == 0) return false;
        if (before != kNone && layer(k).bin <= layer(before).bin) return false;
      }
    }
    if (in_tile != tiles_[slot].layers) return false;
    used += in_tile;
  }
  for (std::int32_t k = free_layer_; k != kNone; k = layer(k).next, ++free)
    if (!meet(k)) return false;
  return used == static_cast<std::size_t>(counters_.layers) && used + free == layers_.size();
}

void QuadtreeMap::save(rt::StateWriter& writer) const {
  const Impl& map = *impl_;
  writer.section(kTag, kVersion, [&] {
    writer(map.now, map.observations, map.removed, map.refused, map.skipped_triangles, map.store);
  });
}

bool QuadtreeMap::load(rt::StateReader& reader) {
  Impl& map = *impl_;
  return reader.section(kTag, kVersion, [&] {
    reader(map.now, map.observations, map.removed, map.refused, map.skipped_triangles, map.store);
  });
}

}  // namespace fathom::fusion
