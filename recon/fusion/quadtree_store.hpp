#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "recon/fusion/mesh_observations.hpp"
#include "recon/fusion/quadtree_map.hpp"
#include "recon/fusion/tile_index.hpp"
#include "recon/geometry/height_tile.hpp"

namespace fathom::fusion {

// The map's sums: tiles of 16 x 16 cells in a quadtree, each cell a list of layers; two pools and an index,
// all of fixed size. Squares of several levels can have sums over the same ground: each observation is kept
// at its own level. Only a coarsened ("closed") square takes finer observations, present and later, into its
// own sums. So the content of every square depends on the meshes and the closed squares alone, not on the
// order of calls. Cell g of a level covers [g, g + 1) spacings; tile t has the cells 16 t to 16 t + 15.
class QuadtreeStore {
 public:
  static constexpr int kCells = HeightTile::kCells;
  static constexpr std::int32_t kNone = -1;
  // Rows at a tile's edge that a neighbour's extracted tile depends on.
  static constexpr int kEdgeRows = 2;

  using Heads = std::array<std::int32_t, kCells * kCells>;  // first layer of each cell
  struct Tile {
    TileKey key;
    bool used = false;
    bool closed = false;  // takes finer observations, too
    bool sent = false;    // the ship has it as shown
    std::int32_t next_free = kNone;
    std::uint32_t layers = 0;
    std::uint32_t seen = 0;               // number of the last fuse() here
    std::uint32_t changed = 0;            // of the last fuse() or remove()
    std::array<std::uint32_t, 4> edge{};  // the same for the rows at the south, north, west, east edge
    std::uint32_t relief_of = 0;          // `changed` for which `relief` holds; 0: unknown
    float relief = 0;                     // mean second difference of heights [m]
  };

  explicit QuadtreeStore(const QuadtreeConfig& config);

  // Back to the state after construction.
  void clear();

  [[nodiscard]] double tileSize(int level) const { return config_.root_size / (1 << level); }
  [[nodiscard]] double spacing(int level) const { return tileSize(level) / kCells; }
  [[nodiscard]] int binShiftOf(int level) const { return bin_shift_[static_cast<std::size_t>(level)]; }

  // Adds observations, all or none: false when there is no room even with everything else coarsened.
  bool add(std::span<const CellObservation> observations, std::uint32_t now);
  // Subtracts observations that add() added.
  void subtract(std::span<const CellObservation> observations, std::uint32_t now);
  // Adds the squares below into the square; only one level may be below it.
  void coarsen(const TileKey& parent, std::uint32_t now);
  // Whether exactly one level of squares is below.
  [[nodiscard]] bool canCoarsen(const TileKey& parent) const;

  void noteVehicle(const Eigen::Vector2d& north_east) { vehicle_ = north_east; }
  void noteSent(const TileKey& key);

  [[nodiscard]] const TileIndex& index() const { return index_; }
  [[nodiscard]] const Tile& tile(std::int32_t slot) const { return tiles_[static_cast<std::size_t>(slot)]; }
  [[nodiscard]] const std::vector<Tile>& tiles() const { return tiles_; }
  [[nodiscard]] std::int32_t head(std::int32_t slot, int cell) const {
    return heads_[static_cast<std::size_t>(slot)][static_cast<std::size_t>(cell)];
  }
  [[nodiscard]] const Layer& layer(std::int32_t at) const { return layers_[static_cast<std::size_t>(at)]; }
  [[nodiscard]] const QuadtreeConfig& config() const { return config_; }
  [[nodiscard]] std::size_t memoryBytes() const;

  struct Counters {
    int tiles = 0, tiles_high_water = 0;
    int layers = 0, layers_high_water = 0;
    std::uint64_t coarsened = 0;
    std::uint64_t outvoted = 0;  // observations added to another layer than the one shown
    std::uint64_t missing = 0;   // observations to subtract that were not there
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

  // In quadtree_state.cpp. A store is empty after a failed load().
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  static void exchangeTile(auto& archive, auto& tile);
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  void loadLayers(rt::StateReader& reader);
  // Invariants of a loaded store.
  [[nodiscard]] bool isNameable(const TileKey& key) const;
  [[nodiscard]] bool loadIndex();
  [[nodiscard]] bool tilesAreWhole() const;
  [[nodiscard]] bool layersAreWhole() const;

  struct Owner {
    std::int32_t slot = kNone;
    int coarser = 0;  // levels between the observation's and the owner's
  };
  struct Candidate {
    TileKey parent;
    std::uint32_t changed = 0;
    double value = 0;
  };

  [[nodiscard]] Tile& at(std::int32_t slot) { return tiles_[static_cast<std::size_t>(slot)]; }
  [[nodiscard]] std::int32_t& headAt(std::int32_t slot, int cell) {
    return heads_[static_cast<std::size_t>(slot)][static_cast<std::size_t>(cell)];
  }
  [[nodiscard]] Layer& layerAt(std::int32_t k) { return layers_[static_cast<std::size_t>(k)]; }
  [[nodiscard]] Owner findOwner(const TileKey& key) const;
  [[nodiscard]] bool addOne(const CellObservation& o, const Owner& owner, std::uint32_t now);
  void subtractOne(const CellObservation& o, const Owner& owner, std::uint32_t now);
  void noteChanged(std::int32_t slot, int cell, std::uint32_t now);
  std::int32_t takeTile(const TileKey& key, std::uint32_t now);
  void releaseTile(std::int32_t slot);
  std::int32_t takeLayer();
  void releaseLayer(std::int32_t k);
  void mergeInto(Heads& heads, int cell, std::int32_t layer, int child_shift, int parent_shift);
  // These are in cell_reading.cpp.

  // Whether a tile, a layer and index entries for a path are free.
  [[nodiscard]] bool hasRoom() const;
  // Coarsens groups of least value until there is room; false: everything is as coarse as possible.
  bool makeRoom(std::uint32_t now);
  void findCandidates(std::uint32_t now);
  [[nodiscard]] Candidate valueOf(const TileKey& parent, std::uint32_t now) const;
  // Measures the relief of a few tiles again, in turn.
  void refreshRelief();
  [[nodiscard]] float measureRelief(std::int32_t slot) const;

  QuadtreeConfig config_;
  TileIndex index_;
  std::array<int, 16> bin_shift_{};
  std::vector<Tile> tiles_;
  std::vector<Heads> heads_;
  std::vector<Layer> layers_;
  std::vector<Candidate> candidates_;  // groups that may be coarsened, the least valuable last
  std::size_t candidates_left_ = 0;    // to be used before the next findCandidates()
  std::size_t relief_next_ = 0;        // next tile of refreshRelief()
  Heads merged_{};                     // of coarsen()
  std::int32_t free_tile_ = kNone, free_layer_ = kNone;
  Eigen::Vector2d vehicle_ = Eigen::Vector2d::Constant(std::nan(""));
  Counters counters_;
  std::uint64_t shape_changes_ = 0;  // of the set of squares
};

// State of a QuadtreeMap: fuse(), remove() and leaves are in quadtree_map.cpp, tiles in quadtree_extract.cpp.
struct QuadtreeMap::Impl {
  struct Leaf {
    std::uint64_t key = 0;  // packed
    std::uint32_t revision = 0;
  };

  explicit Impl(const QuadtreeConfig& config) : store(config), seen(config) {
    // Each square in the index has four children at most.
    leaves.reserve(4 * store.index().capacity());
  }

  void findLeaves(int finest);
  void leavesBelow(const TileKey& key, bool shows_through, int finest);
  // Number of the last change that can have changed a tile.
  [[nodiscard]] std::uint32_t revisionOf(const TileKey& key) const;

  QuadtreeStore store;
  MeshObservations seen;
  std::vector<Leaf> leaves;  // see forEachLeaf()
  std::uint32_t now = 0;     // number of the running fuse() or remove()
  std::uint64_t observations = 0, removed = 0, refused = 0, skipped_triangles = 0;
};

}  // namespace fathom::fusion
