#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "recon/fusion/quadtree_map.hpp"
#include "recon/fusion/tile_index.hpp"
#include "recon/geometry/height_tile.hpp"

namespace fathom::fusion {

// The quadtree's tiles: fixed pool, index, and the changes of its shape (create, split, coarsen). Positions
// are lattice indices: node g of a level stands at g * spacing(level); tile t owns the nodes 16 t to 16 t
// + 15.
class QuadtreeStore {
 public:
  static constexpr int kCells = HeightTile::kCells;
  static constexpr std::int32_t kNone = -1;

  // What a node knows, and the observation that the mesh being fused has for it.
  struct Node {
    float depth = 0;        // weighted mean of nav z [m]
    float information = 0;  // sum of 1 / sigma^2 [1/m^2]; 0: never seen
    float scatter = 0;      // sum of squared deviations from the mean, each over sigma^2 (West 1979)
    float pending_depth = 0;
    float pending_sigma = 0;                // 0: no observation pending
    std::array<std::uint16_t, 3> colour{};  // 1/256 of an 8-bit step
    std::uint8_t count = 0;                 // meshes that agreed, saturating
    std::uint8_t disagreements = 0;         // votes against, see QuadtreeMap
    Rgb pending_colour{};

    [[nodiscard]] bool seen() const { return information > 0; }
    // Variance of the mean [m^2]: of the observations, and of their disagreement.
    [[nodiscard]] float variance() const {
      return (1.0F + scatter / static_cast<float>(count > 0 ? count : 1)) / information;
    }
    [[nodiscard]] Rgb rgb() const {
      const auto byte = [](std::uint16_t c) {
        return static_cast<std::uint8_t>(c >= 0xFF00 ? 255 : (c + 128) / 256);
      };
      return {byte(colour[0]), byte(colour[1]), byte(colour[2])};
    }
  };
  using Nodes = std::array<Node, kCells * kCells>;

  struct Leaf {
    TileKey key;
    bool used = false;
    bool touched = false;            // has pending observations
    std::int32_t next_free = kNone;  // list of free slots
    std::uint32_t observed = 0;      // number of the fuse() that last saw it
    std::uint32_t revision = 0;      // number of the fuse() that last changed it
  };

  explicit QuadtreeStore(const QuadtreeConfig& config);

  // Back to the state after construction.
  void clear();

  [[nodiscard]] double tileSize(int level) const { return config_.root_size / (1 << level); }
  [[nodiscard]] double spacing(int level) const { return tileSize(level) / kCells; }

  [[nodiscard]] std::int32_t find(const TileKey& key) const { return index_.find(key); }
  // Slot of the leaf that owns node (gi, gj) of `level` (any level); kNone where there is none.
  [[nodiscard]] std::int32_t leafAt(int level, std::int64_t gi, std::int64_t gj) const;

  // Makes sure that a leaf owns node (gi, gj) of `level`, of that level where the tree allows it: splits a
  // coarser leaf while the pool has its reserve, coarsens elsewhere when the pool is empty. False: refused.
  bool ensure(int level, std::int64_t gi, std::int64_t gj, std::uint32_t now);

  // Value at node (gi, gj) of `level` as the leaves give it: the node itself, the same place in a finer leaf,
  // or interpolated in a coarser one. Node::seen() is false where nothing was seen.
  [[nodiscard]] Node sample(int level, std::int64_t gi, std::int64_t gj) const;

  [[nodiscard]] Leaf& leaf(std::int32_t slot) { return leaves_[static_cast<std::size_t>(slot)]; }
  [[nodiscard]] const Leaf& leaf(std::int32_t slot) const { return leaves_[static_cast<std::size_t>(slot)]; }
  [[nodiscard]] Nodes& nodes(std::int32_t slot) { return nodes_[static_cast<std::size_t>(slot)]; }
  [[nodiscard]] const Nodes& nodes(std::int32_t slot) const { return nodes_[static_cast<std::size_t>(slot)]; }
  [[nodiscard]] const std::vector<Leaf>& leaves() const { return leaves_; }
  [[nodiscard]] int used() const { return used_; }
  [[nodiscard]] int highWater() const { return high_water_; }
  [[nodiscard]] std::uint64_t coarsened() const { return coarsened_; }
  // Counts changes of the tree's shape.
  [[nodiscard]] std::uint64_t shapeChanges() const { return shape_changes_; }
  [[nodiscard]] std::size_t memoryBytes() const;
  [[nodiscard]] const QuadtreeConfig& config() const { return config_; }

  static TileKey child(const TileKey& key, int i, int j) {
    return {key.north_index * 2 + i, key.east_index * 2 + j, static_cast<std::int16_t>(key.level + 1)};
  }

 private:
  std::int32_t take(const TileKey& key, std::uint32_t now);
  void release(std::int32_t slot);
  bool makeRoom(std::uint32_t now);
  bool groupIsLeaves(const TileKey& parent, std::uint32_t& observed) const;
  void coarsen(const TileKey& parent, std::uint32_t now);
  void split(std::int32_t slot, std::uint32_t now);

  QuadtreeConfig config_;
  TileIndex index_;
  std::vector<Leaf> leaves_;
  std::vector<Nodes> nodes_;
  std::array<Nodes, 4> scratch_{};  // of split() and coarsen()
  std::int32_t first_free_ = kNone;
  int used_ = 0, high_water_ = 0;
  int split_reserve_ = 0;  // tiles kept for new ground: no splits below it
  std::uint64_t coarsened_ = 0, shape_changes_ = 0;
};

}  // namespace fathom::fusion
