#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <unordered_map>
#include <vector>

namespace fathom::fusion {

// What one voxel centre knows (Curless & Levoy's D and W).
struct Voxel {
  float distance = 0;                     // weighted mean, positive on the cameras' side [m]
  float weight = 0;                       // sum of weights [1/m^2]; 0: never seen
  std::array<std::uint16_t, 3> colour{};  // weighted mean, 1/256 of an 8-bit step
  std::uint16_t observations = 0;         // saturating
};

struct BlockKey {
  std::int32_t x = 0, y = 0, z = 0;
  bool operator==(const BlockKey&) const = default;
  auto operator<=>(const BlockKey&) const = default;
};

// Sparse grid of voxels in blocks of 8^3, found by hashing. Voxel (i, j, k) has its centre at (i, j, k) *
// edge.
class VoxelGrid {
 public:
  static constexpr int kEdge = 8;
  static constexpr int kVoxels = kEdge * kEdge * kEdge;
  using Block = std::array<Voxel, kVoxels>;

  static std::size_t local(int x, int y, int z) {
    return static_cast<std::size_t>((z * kEdge + y) * kEdge + x);
  }

  // Null where there is none.
  [[nodiscard]] const Block* find(const BlockKey& key) const {
    const auto found = index_.find(key);
    return found == index_.end() ? nullptr : &blocks_[found->second];
  }
  [[nodiscard]] Block* find(const BlockKey& key) {
    return const_cast<Block*>(static_cast<const VoxelGrid*>(this)->find(key));
  }
  Block& make(const BlockKey& key) {
    const auto [at, is_new] = index_.try_emplace(key, static_cast<std::uint32_t>(blocks_.size()));
    if (is_new) {
      blocks_.emplace_back();
      keys_.push_back(key);
    }
    return blocks_[at->second];
  }

  // Keys of all blocks, in the order in which they were made.
  [[nodiscard]] const std::vector<BlockKey>& keys() const { return keys_; }

  // Blocks, keys, and the index (a node of two pointers' overhead an entry, and its buckets).
  [[nodiscard]] std::size_t memoryBytes() const {
    return blocks_.size() * sizeof(Block) + keys_.capacity() * sizeof(BlockKey) +
           index_.size() * (sizeof(BlockKey) + sizeof(std::uint32_t) + 2 * sizeof(void*)) +
           index_.bucket_count() * sizeof(void*);
  }

 private:
  struct Hash {
    std::size_t operator()(const BlockKey& k) const {
      // Teschner et al. 2003, "Optimized spatial hashing".
      return static_cast<std::size_t>(k.x) * 73856093U ^ static_cast<std::size_t>(k.y) * 19349669U ^
             static_cast<std::size_t>(k.z) * 83492791U;
    }
  };
  std::deque<Block> blocks_;  // grows without moving what is there
  std::vector<BlockKey> keys_;
  std::unordered_map<BlockKey, std::uint32_t, Hash> index_;
};

}  // namespace fathom::fusion
