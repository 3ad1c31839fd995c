#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace fathom::onboard {

// Pairs of keyframes that were tried, each with their separation then, so that a pair is tried again only
// when that has changed. A hash table of fixed size; when it is full it forgets everything, which only costs
// time.
class TriedPairs {
 public:
  // `capacity`: pairs, rounded up to a power of two.
  explicit TriedPairs(std::size_t capacity) {
    std::size_t size = 16;
    while (size < 2 * capacity) size *= 2;
    table_.assign(size, {});
  }

  // Tried at this separation [m]; another one by more than `within` [m] is another try.
  void insert(int a, int b, const Eigen::Vector2d& separation, double within) {
    if (2 * count_ >= table_.size()) {
      table_.assign(table_.size(), {});
      count_ = 0;
    }
    Tried& tried = table_[find(key(a, b))];
    if (tried.pair == 0) ++count_;
    tried = {key(a, b), separation.cast<float>(), static_cast<float>(within)};
  }
  // Tried as it is for ever.
  void insert(int a, int b) { insert(a, b, {0, 0}, std::numeric_limits<double>::infinity()); }

  [[nodiscard]] bool contains(int a, int b, const Eigen::Vector2d& separation) const {
    const Tried& tried = table_[find(key(a, b))];
    return tried.pair != 0 && (separation.cast<float>() - tried.separation).norm() <= tried.within;
  }
  [[nodiscard]] bool contains(int a, int b) const { return contains(a, b, {0, 0}); }
  [[nodiscard]] std::size_t memoryBytes() const { return table_.size() * sizeof(table_[0]); }

  // For saved state (state_archive.hpp): the same pairs.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t count = self.count_;
    archive(count);
    archive.require(2 * count <= self.table_.size(), "more pairs than there is room for");
    if constexpr (Archive::kLoading) {
      self.table_.assign(self.table_.size(), {});
      self.count_ = 0;
      for (Tried tried; self.count_ < count; ++self.count_) {
        archive(tried.pair, tried.separation, tried.within);
        if (!archive.ok()) return;
        Tried& place = self.table_[self.find(tried.pair)];
        archive.require(tried.pair != 0 && place.pair == 0, "a pair that comes twice");
        place = tried;
      }
    } else {
      for (const Tried& tried : self.table_)
        if (tried.pair != 0) archive(tried.pair, tried.separation, tried.within);
    }
  }

 private:
  struct Tried {
    std::uint64_t pair = 0;  // 0: an empty place
    Eigen::Vector2f separation = Eigen::Vector2f::Zero();
    float within = 0;
  };
  // Never 0.
  static std::uint64_t key(int a, int b) {
    return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(a) + 1U) << 32) |
           static_cast<std::uint32_t>(b);
  }
  [[nodiscard]] std::size_t find(std::uint64_t wanted) const {
    constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;  // Fibonacci hashing (Knuth 1973, 6.4)
    const std::size_t mask = table_.size() - 1;
    std::size_t at = static_cast<std::size_t>((wanted * kGolden) >> 20) & mask;
    while (table_[at].pair != 0 && table_[at].pair != wanted) at = (at + 1) & mask;
    return at;
  }
  std::vector<Tried> table_;
  std::size_t count_ = 0;
};

}  // namespace fathom::onboard
