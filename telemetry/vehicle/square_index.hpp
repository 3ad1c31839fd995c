#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "telemetry/map/map_block.hpp"

namespace fathom::telemetry {

inline constexpr int kBlocksASide = 4;  // of a square of 16 x 16 nodes

// Quotient rounded down: the square that holds a block, or the coarse block over a fine one.
[[nodiscard]] constexpr std::int32_t floorDiv(std::int32_t a, std::int32_t b) {
  return a / b - (a % b != 0 && (a < 0) != (b < 0) ? 1 : 0);
}

// Finds a square's slot by its lattice and place: open addressing in a table sized once for `capacity`
// entries, at most half full.
class SquareIndex {
 public:
  explicit SquareIndex(std::size_t capacity) {
    std::size_t size = 16;
    while (size < 2 * capacity) size *= 2;
    table_.assign(size, Entry{});
  }
  [[nodiscard]] std::optional<std::size_t> find(SpacingCode spacing, std::int32_t north,
                                                std::int32_t east) const {
    const std::uint64_t key = pack(spacing, north, east);
    for (std::size_t at = home(key); table_[at].slot >= 0; at = (at + 1) % table_.size())
      if (table_[at].key == key) return static_cast<std::size_t>(table_[at].slot);
    return std::nullopt;
  }
  void add(SpacingCode spacing, std::int32_t north, std::int32_t east, std::size_t slot) {
    const std::uint64_t key = pack(spacing, north, east);
    std::size_t at = home(key);
    while (table_[at].slot >= 0) at = (at + 1) % table_.size();
    table_[at] = {key, static_cast<std::int32_t>(slot)};
  }
  void clear() { std::fill(table_.begin(), table_.end(), Entry{}); }
  [[nodiscard]] std::size_t memoryBytes() const { return table_.size() * sizeof(Entry); }

 private:
  struct Entry {
    std::uint64_t key = 0;
    std::int32_t slot = -1;
  };
  static std::uint64_t pack(SpacingCode spacing, std::int32_t north, std::int32_t east) {
    constexpr std::uint64_t kMask = (1U << 24) - 1;  // 16 million squares in each direction
    return std::uint64_t{spacing} << 48 | (static_cast<std::uint64_t>(north) & kMask) << 24 |
           (static_cast<std::uint64_t>(east) & kMask);
  }
  [[nodiscard]] std::size_t home(std::uint64_t key) const {
    key *= 0x9e3779b97f4a7c15ULL;  // Fibonacci hashing: neighbours land far apart
    return static_cast<std::size_t>(key >> 32) % table_.size();
  }
  std::vector<Entry> table_;
};

}  // namespace fathom::telemetry
