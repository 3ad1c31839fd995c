// Saved state of the onboard map. Tiles are saved up to their high-water mark with the free ones, so that
// free tiles are taken in the same order and the loaded map continues bit by bit as the saved one. Layers are
// saved tile by tile and cell by cell as packed numbers, since their places in the pool have no meaning and
// half of their 48 bytes are zeros. The index is rebuilt from the tiles.
#include <cmath>

#include "realtime/base/bytes/packed_numbers.hpp"
#include "recon/fusion/quadtree_store.hpp"
#include "recon/geometry/state_values.hpp"

namespace fathom::fusion {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("QUAD"), kVersion = 2;
// Far beyond the 100 km up to which meshes are fused, and within the range of the index.
constexpr std::int32_t kFarthestIndex = 1 << 26;

void exchangeKey(auto& archive, auto& key) {
  archive(key.north_index, key.east_index, key.level);
}

// Small where a number is near zero, of either sign.
std::uint64_t folded(std::int32_t value) {
  return static_cast<std::uint32_t>(value) << 1 ^ (value < 0 ? 0xFFFFFFFFU : 0U);
}
std::int32_t unfolded(std::uint64_t value) {
  const auto half = static_cast<std::int32_t>(value >> 1 & 0x7FFFFFFF);
  return (value & 1) != 0 ? ~half : half;
}

// A layer's numbers; its bin by the difference to the one before it.
rt::EightNumbers numbersOf(const Layer& layer, std::int32_t bin_before) {
  const LayerSums& s = layer.sums;
  const auto step = static_cast<std::int32_t>(static_cast<std::uint32_t>(layer.bin) -
                                              static_cast<std::uint32_t>(bin_before));
  return {s.count(),   s.weight(),  s.height(),  s.squares(),
          s.colour(0), s.colour(1), s.colour(2), folded(step)};
}
// False when the numbers cannot be a layer's.
bool takeNumbers(const rt::EightNumbers& n, std::int32_t bin_before, Layer& layer) {
  const auto [count, weight, height, squares, red, green, blue, step] = n;
  if (!LayerSums::fits(count, weight, {red, green, blue}) || step >> 32 != 0) return false;
  layer.sums = LayerSums::from(count, weight, height, squares, {red, green, blue});
  layer.bin = static_cast<std::int32_t>(static_cast<std::uint32_t>(bin_before) +
                                        static_cast<std::uint32_t>(unfolded(step)));
  return true;
}

// Buffers small numbers, so that the writer's bounds are checked once for many.
class Batch {
 public:
  explicit Batch(rt::StateWriter& writer) : writer_(writer) {}
  ~Batch() { flush(); }
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;
  void layer(const rt::EightNumbers& numbers) { used_ += rt::packNumbers(numbers, room()); }
  // Seven bits a byte, the lowest first; the highest bit: another byte follows.
  void number(std::uint32_t n) {
    std::uint8_t* to = room();
    for (; n >= kMore; n >>= 7, ++used_) *to++ = static_cast<std::uint8_t>(n | kMore);
    *to = static_cast<std::uint8_t>(n);
    ++used_;
  }
  static constexpr std::uint32_t kMore = 0x80;

 private:
  std::uint8_t* room() {
    if (bytes_.size() - used_ < rt::kMostPacked) flush();
    return bytes_.data() + used_;
  }
  void flush() {
    writer_.bytes(bytes_.data(), used_);
    used_ = 0;
  }
  rt::StateWriter& writer_;
  std::array<std::uint8_t, 4096> bytes_;
  std::size_t used_ = 0;
};

std::uint32_t readNumber(rt::StateReader& reader) {
  std::uint32_t n = 0;
  for (unsigned shift = 0; shift < 32; shift += 7) {
    std::uint8_t byte = 0;
    reader.bytes(&byte, 1);
    n |= (byte & (Batch::kMore - 1)) << shift;
    if ((byte & Batch::kMore) == 0) return n;
  }
  reader.fail("a number that does not end");
  return 0;
}

}  // namespace

void QuadtreeStore::exchangeTile(auto& archive, auto& t) {
  archive(t.used, t.next_free);
  if (!t.used) return;
  exchangeKey(archive, t.key);
  archive(t.closed, t.sent, t.layers, t.seen, t.changed, t.edge, t.relief_of, t.relief);
}

template <typename Archive, typename Self>
void QuadtreeStore::exchange(Archive& archive, Self& self) {
  archive(self.counters_, self.shape_changes_, self.free_tile_, self.vehicle_);
  const auto tiles = static_cast<std::size_t>(self.counters_.tiles_high_water);
  archive.require(self.counters_.tiles_high_water >= 0 && tiles <= self.tiles_.size() &&
                      self.counters_.layers_high_water >= self.counters_.layers &&
                      self.counters_.layers >= 0 &&
                      static_cast<std::size_t>(self.counters_.layers_high_water) <= self.layers_.size(),
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
  // The candidates used before the next comparison of all: the last ones.
  for (std::size_t k = self.candidates_.size() - self.candidates_left_; k < self.candidates_.size(); ++k) {
    exchangeKey(archive, self.candidates_[k].parent);
    archive(self.candidates_[k].changed, self.candidates_[k].value);
  }
  for (std::size_t k = 0; k < tiles; ++k) exchangeTile(archive, self.tiles_[k]);
}

void QuadtreeStore::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
  Batch batch(writer);
  const auto tiles = static_cast<std::size_t>(counters_.tiles_high_water);
  std::int32_t bin = 0;
  for (std::size_t slot = 0; slot < tiles; ++slot) {
    if (!tiles_[slot].used) continue;
    for (const std::int32_t head : heads_[slot])
      if (head != kNone) __builtin_prefetch(&layer(head));
    for (const std::int32_t head : heads_[slot]) {
      std::uint32_t layers = 0;
      for (std::int32_t k = head; k != kNone; k = layer(k).next) ++layers;
      batch.number(layers);
      for (std::int32_t k = head; k != kNone; k = layer(k).next) {
        batch.layer(numbersOf(layer(k), bin));
        bin = layer(k).bin;
      }
    }
  }
}

// The pool's places in the order of tiles and cells; those behind them are free.
void QuadtreeStore::loadLayers(rt::StateReader& reader) {
  std::int32_t next = 0, bin = 0;
  const auto loadOne = [&](Layer& to) {
    std::uint32_t lengths = 0;
    std::array<std::uint8_t, rt::kMostPacked> bytes{};
    reader(lengths);
    const std::size_t size = rt::packedBytes(lengths);
    reader.require(size < rt::kMostPacked, "a layer that is too long");
    reader.bytes(bytes.data(), size);
    reader.require(takeNumbers(rt::unpackNumbers(reader.ok() ? lengths : 0, bytes.data()), bin, to),
                   "a layer that cannot be");
    bin = to.bin;
  };
  for (std::size_t slot = 0; slot < tiles_.size(); ++slot) {
    if (!tiles_[slot].used) continue;
    for (std::int32_t& head : heads_[slot]) {
      const std::uint32_t layers = readNumber(reader);
      reader.require(layers <= layers_.size() - static_cast<std::size_t>(next), "more layers than there are");
      if (!reader.ok()) return;
      head = layers > 0 ? next : kNone;
      for (std::uint32_t k = 0; k < layers && reader.ok(); ++k, ++next) {
        loadOne(layerAt(next));
        layerAt(next).next = k + 1 < layers ? next + 1 : kNone;
      }
    }
  }
  free_layer_ = static_cast<std::size_t>(next) < layers_.size() ? next : kNone;
}

bool QuadtreeStore::load(rt::StateReader& reader) {
  clear();
  exchange(reader, *this);
  if (reader.ok()) loadLayers(reader);
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

// Free and used tiles are all tiles, each once.
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

// The same of layers, with those of a cell in order.
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
