#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace fathom::onboard {

// Pairs of keyframes that were tried, so that none is tried twice. A hash table of fixed size; when it is
// full it forgets everything, which costs time but nothing else.
class TriedPairs {
 public:
  // `capacity`: pairs, rounded up to a power of two.
  explicit TriedPairs(std::size_t capacity) {
    std::size_t size = 16;
    while (size < 2 * capacity) size *= 2;
    table_.assign(size, 0);
  }

  // False when it was there already.
  bool insert(int a, int b) {
    if (2 * count_ >= table_.size()) {
      table_.assign(table_.size(), 0);
      count_ = 0;
    }
    const std::size_t at = find(key(a, b));
    if (table_[at] != 0) return false;
    table_[at] = key(a, b);
    ++count_;
    return true;
  }
  [[nodiscard]] bool contains(int a, int b) const { return table_[find(key(a, b))] != 0; }
  [[nodiscard]] std::size_t memoryBytes() const { return table_.size() * sizeof(table_[0]); }

  // For saved state (state_archive.hpp): the same pairs.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t count = self.count_;
    archive(count);
    archive.require(2 * count <= self.table_.size(), "more pairs than there is room for");
    if constexpr (Archive::kLoading) {
      self.table_.assign(self.table_.size(), 0);
      self.count_ = 0;
      for (std::uint64_t pair = 0; self.count_ < count && archive(pair); ++self.count_) {
        std::uint64_t& place = self.table_[self.find(pair)];
        archive.require(pair != 0 && place == 0, "a pair that comes twice");
        place = pair;
      }
    } else {
      for (const std::uint64_t pair : self.table_)
        if (pair != 0) archive(pair);
    }
  }

 private:
  // Never 0, which marks an empty place.
  static std::uint64_t key(int a, int b) {
    return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(a) + 1U) << 32) |
           static_cast<std::uint32_t>(b);
  }
  [[nodiscard]] std::size_t find(std::uint64_t wanted) const {
    constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;  // Fibonacci hashing (Knuth 1973, 6.4)
    const std::size_t mask = table_.size() - 1;
    std::size_t at = static_cast<std::size_t>((wanted * kGolden) >> 20) & mask;
    while (table_[at] != 0 && table_[at] != wanted) at = (at + 1) & mask;
    return at;
  }
  std::vector<std::uint64_t> table_;
  std::size_t count_ = 0;
};

}  // namespace fathom::onboard
