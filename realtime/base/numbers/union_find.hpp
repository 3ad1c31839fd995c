#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace fathom {

// Disjoint sets of the numbers 0 to count - 1 (union-find with path halving). The least number of a set
// represents it.
class UnionFind {
 public:
  explicit UnionFind(std::size_t count = 0) { reset(count); }
  void reserve(std::size_t count) { parent_.reserve(count); }
  // Puts every number into a set of its own; reuses the memory.
  void reset(std::size_t count) {
    parent_.resize(count);
    std::iota(parent_.begin(), parent_.end(), 0U);
  }
  [[nodiscard]] std::uint32_t root(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

}  // namespace fathom
