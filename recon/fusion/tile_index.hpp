#pragma once

#include <cstdint>
#include <vector>

#include "recon/fusion/quadtree_map.hpp"

namespace fathom::fusion {

// Hash index from tile key to what stands there: nothing, an inner node of the quadtree, or a leaf's slot in
// the pool. Open addressing in a table sized once; entries are never removed singly except by coarsening
// (backward shift).
class TileIndex {
 public:
  static constexpr std::int32_t kAbsent = -2;
  static constexpr std::int32_t kInner = -1;

  // `capacity`: entries that must fit; the table is kept at most half full.
  explicit TileIndex(std::size_t capacity) {
    std::size_t size = 16;
    while (size < 2 * capacity) size *= 2;
    table_.assign(size, Entry{0, kAbsent});
    mask_ = size - 1;
  }

  // Key order: level, north, east.
  static std::uint64_t pack(const TileKey& key) {
    constexpr std::int64_t kBias = std::int64_t{1} << 27;  // indices within +-2^27
    return (static_cast<std::uint64_t>(key.level) << 56) |
           (static_cast<std::uint64_t>(key.north_index + kBias) << 28) |
           static_cast<std::uint64_t>(key.east_index + kBias);
  }

  [[nodiscard]] std::int32_t find(const TileKey& key) const {
    const std::uint64_t packed = pack(key);
    for (std::size_t at = home(packed);; at = (at + 1) & mask_) {
      if (table_[at].value == kAbsent) return kAbsent;
      if (table_[at].key == packed) return table_[at].value;
    }
  }

  // Inserts or overwrites.
  void set(const TileKey& key, std::int32_t value) {
    const std::uint64_t packed = pack(key);
    std::size_t at = home(packed);
    while (table_[at].value != kAbsent && table_[at].key != packed) at = (at + 1) & mask_;
    table_[at] = {packed, value};
  }

  void erase(const TileKey& key) {
    const std::uint64_t packed = pack(key);
    std::size_t hole = home(packed);
    while (table_[hole].value != kAbsent && table_[hole].key != packed) hole = (hole + 1) & mask_;
    if (table_[hole].value == kAbsent) return;
    for (std::size_t at = (hole + 1) & mask_; table_[at].value != kAbsent; at = (at + 1) & mask_) {
      // An entry may move back into the hole unless its home lies between the hole and itself.
      const std::size_t from_home = (at - home(table_[at].key)) & mask_;
      if (from_home >= ((at - hole) & mask_)) {
        table_[hole] = table_[at];
        hole = at;
      }
    }
    table_[hole].value = kAbsent;
  }

  void clear() {
    for (Entry& e : table_) e = {0, kAbsent};
  }

  [[nodiscard]] std::size_t memoryBytes() const { return table_.size() * sizeof(Entry); }

 private:
  struct Entry {
    std::uint64_t key;
    std::int32_t value;
  };

  [[nodiscard]] std::size_t home(std::uint64_t packed) const {
    packed ^= packed >> 31;  // splitmix64's finaliser: neighbouring keys land far apart
    packed *= 0xbf58476d1ce4e5b9ULL;
    packed ^= packed >> 27;
    packed *= 0x94d049bb133111ebULL;
    packed ^= packed >> 31;
    return static_cast<std::size_t>(packed) & mask_;
  }

  std::vector<Entry> table_;
  std::size_t mask_ = 0;
};

}  // namespace fathom::fusion
