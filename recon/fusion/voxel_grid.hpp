#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <vector>

namespace fathom::fusion {

struct VoxelBlockKey {
  std::int32_t x = 0, y = 0, z = 0;
  bool operator==(const VoxelBlockKey&) const = default;
  auto operator<=>(const VoxelBlockKey&) const = default;
};

// The voxels of a block (Curless & Levoy's D and W): an array for each quantity, so that a column of eight
// voxels along z is one load.
struct VoxelBlock {
  static constexpr int kEdge = 8;
  static constexpr int kVoxels = kEdge * kEdge * kEdge;
  template <typename T>
  using Values = std::array<T, kVoxels>;

  Values<float> distance{};                       // weighted mean, positive on the cameras' side [m]
  Values<float> weight{};                         // sum of weights [1/m^2]; 0: never seen
  std::array<Values<std::uint16_t>, 3> colour{};  // weighted mean, 1/256 of an 8-bit step
  Values<std::uint16_t> observations{};           // saturating

  static constexpr std::size_t local(int x, int y, int z) {
    return static_cast<std::size_t>((x * kEdge + y) * kEdge + z);
  }
};

inline constexpr int kBlockEdge = VoxelBlock::kEdge;

// Sparse grid of voxels in blocks of 8^3, found by hashing (open addressing). Voxel (i, j, k) has its centre
// at (i, j, k) * edge. Blocks are numbered in the order of their creation and never move.
class VoxelGrid {
 public:
  static constexpr std::uint32_t kNone = 0xFFFFFFFF;

  VoxelGrid() : slots_(kFirstSlots) {}

  // Number of the block; kNone without a block there.
  [[nodiscard]] std::uint32_t number(const VoxelBlockKey& key) const {
    for (std::size_t at = hash(key) & (slots_.size() - 1);; at = (at + 1) & (slots_.size() - 1)) {
      if (slots_[at].block == kNone || slots_[at].key == key) return slots_[at].block;
    }
  }
  [[nodiscard]] VoxelBlock* find(const VoxelBlockKey& key) {
    const std::uint32_t found = number(key);
    return found == kNone ? nullptr : &blocks_[found];
  }
  VoxelBlock& make(const VoxelBlockKey& key) {
    if (VoxelBlock* found = find(key)) return *found;
    if (2 * (keys_.size() + 1) > slots_.size()) grow();
    insert(key, static_cast<std::uint32_t>(keys_.size()));
    keys_.push_back(key);
    return blocks_.emplace_back();
  }
  [[nodiscard]] const VoxelBlock& block(std::uint32_t number) const { return blocks_[number]; }
  [[nodiscard]] VoxelBlock& block(std::uint32_t number) { return blocks_[number]; }

  // Keys of all blocks, by number.
  [[nodiscard]] const std::vector<VoxelBlockKey>& keys() const { return keys_; }

  // Blocks, keys and the index.
  [[nodiscard]] std::size_t memoryBytes() const {
    return blocks_.size() * (sizeof(VoxelBlock) + sizeof(void*)) + keys_.capacity() * sizeof(VoxelBlockKey) +
           slots_.size() * sizeof(Slot);
  }

 private:
  static constexpr std::size_t kFirstSlots = 256;  // a power of two, as after every growth
  struct Slot {
    VoxelBlockKey key;
    std::uint32_t block = kNone;
  };

  static std::size_t hash(const VoxelBlockKey& k) {
    // Teschner et al. 2003, "Optimized spatial hashing", with the high bits mixed in.
    const std::uint64_t h = static_cast<std::uint64_t>(k.x) * 73856093U ^
                            static_cast<std::uint64_t>(k.y) * 19349669U ^
                            static_cast<std::uint64_t>(k.z) * 83492791U;
    return static_cast<std::size_t>(h ^ h >> 15);
  }
  void insert(const VoxelBlockKey& key, std::uint32_t block) {
    std::size_t at = hash(key) & (slots_.size() - 1);
    while (slots_[at].block != kNone) at = (at + 1) & (slots_.size() - 1);
    slots_[at] = {key, block};
  }
  void grow() {
    slots_.assign(slots_.size() * 2, Slot{});
    for (std::uint32_t k = 0; k < keys_.size(); ++k) insert(keys_[k], k);
  }

  std::deque<VoxelBlock> blocks_;  // grows without moving its elements
  std::vector<VoxelBlockKey> keys_;
  std::vector<Slot> slots_;
};

}  // namespace fathom::fusion
