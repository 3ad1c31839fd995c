#pragma once

#include <cstdint>
#include <vector>

#include "recon/fusion/quadtree_map.hpp"

namespace fathom::fusion {

// Hash index of the quadtree's squares by tile key: the slot of a square's own sums (if it has any) and the
// number of its children in the index. Open addressing in a table sized once; removal by backward shift.
class TileIndex {
 public:
  static constexpr std::int32_t kAbsent = -2;
  static constexpr std::int32_t kInner = -1;  // without own sums, only with squares below it

  // `capacity`: entries that must fit; the table is kept at most half full.
  explicit TileIndex(std::size_t capacity) : capacity_(capacity) {
    std::size_t size = 16;
    while (size < 2 * capacity) size *= 2;
    table_.assign(size, Entry{});
    mask_ = size - 1;
  }

  // Key order: level, north, east.
  static std::uint64_t pack(const TileKey& key) {
    constexpr std::int64_t kBias = std::int64_t{1} << 27;  // indices within +-2^27
    return (static_cast<std::uint64_t>(key.level) << 56) |
           (static_cast<std::uint64_t>(key.north_index + kBias) << 28) |
           static_cast<std::uint64_t>(key.east_index + kBias);
  }
  static TileKey unpack(std::uint64_t packed) {
    constexpr std::int64_t kBias = std::int64_t{1} << 27;
    constexpr std::uint64_t kMask = (std::uint64_t{1} << 28) - 1;
    return {static_cast<std::int32_t>(static_cast<std::int64_t>((packed >> 28) & kMask) - kBias),
            static_cast<std::int32_t>(static_cast<std::int64_t>(packed & kMask) - kBias),
            static_cast<std::int16_t>(packed >> 56)};
  }
  static TileKey parent(const TileKey& key) {
    return {key.north_index >> 1, key.east_index >> 1, static_cast<std::int16_t>(key.level - 1)};
  }
  static TileKey child(const TileKey& key, int c) {
    return {key.north_index * 2 + c / 2, key.east_index * 2 + c % 2,
            static_cast<std::int16_t>(key.level + 1)};
  }

  [[nodiscard]] std::int32_t find(const TileKey& key) const { return entry(key).value; }
  // Number of the four children in the index.
  [[nodiscard]] int below(const TileKey& key) const { return entry(key).below; }

  // Inserts or overwrites, and inserts missing ancestors. The caller checks room() before.
  void set(const TileKey& key, std::int32_t value) {
    Entry& e = place(key);
    if (e.value != kAbsent) {
      e.value = value;
      return;
    }
    e = {pack(key), value, 0};
    ++used_;
    if (key.level == 0) return;
    const TileKey up = parent(key);
    if (find(up) == kAbsent) set(up, kInner);
    ++place(up).below;
  }
  // Takes the square's own sums away; removes it, and its ancestors, when nothing is below them either.
  void drop(const TileKey& key) {
    Entry& e = place(key);
    if (e.value == kAbsent) return;
    e.value = kInner;
    if (e.below > 0) return;
    erase(key);
    if (key.level == 0) return;
    const TileKey up = parent(key);
    Entry& above = place(up);
    --above.below;
    if (above.below == 0 && above.value == kInner) drop(up);
  }

  // Entries that can still be made.
  [[nodiscard]] std::size_t room() const { return capacity_ - used_; }
  [[nodiscard]] std::size_t capacity() const { return capacity_; }
  // Calls visit(key, value) for every entry, in no particular order.
  void forEach(auto&& visit) const {
    for (const Entry& e : table_)
      if (e.value != kAbsent) visit(unpack(e.key), e.value);
  }

  void clear() {
    for (Entry& e : table_) e = Entry{};
    used_ = 0;
  }

  [[nodiscard]] std::size_t memoryBytes() const { return table_.size() * sizeof(Entry); }

 private:
  struct Entry {
    std::uint64_t key = 0;
    std::int32_t value = kAbsent;
    std::int32_t below = 0;
  };

  [[nodiscard]] std::size_t home(std::uint64_t packed) const {
    packed ^= packed >> 31;  // splitmix64's finaliser: neighbouring keys land far apart
    packed *= 0xbf58476d1ce4e5b9ULL;
    packed ^= packed >> 27;
    packed *= 0x94d049bb133111ebULL;
    packed ^= packed >> 31;
    return static_cast<std::size_t>(packed) & mask_;
  }
  // Place of the key, or the empty place for it.
  [[nodiscard]] std::size_t at(std::uint64_t packed) const {
    std::size_t k = home(packed);
    while (table_[k].value != kAbsent && table_[k].key != packed) k = (k + 1) & mask_;
    return k;
  }
  [[nodiscard]] const Entry& entry(const TileKey& key) const { return table_[at(pack(key))]; }
  [[nodiscard]] Entry& place(const TileKey& key) { return table_[at(pack(key))]; }

  void erase(const TileKey& key) {
    std::size_t hole = at(pack(key));
    for (std::size_t k = (hole + 1) & mask_; table_[k].value != kAbsent; k = (k + 1) & mask_) {
      // An entry may move back into the hole unless its home is between the hole and itself.
      const std::size_t from_home = (k - home(table_[k].key)) & mask_;
      if (from_home >= ((k - hole) & mask_)) {
        table_[hole] = table_[k];
        hole = k;
      }
    }
    table_[hole] = Entry{};
    --used_;
  }

  std::vector<Entry> table_;
  std::size_t mask_ = 0, capacity_, used_ = 0;
};

}  // namespace fathom::fusion
