#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <vector>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::test {

// A piece of one tile's border that the other tile does not have.
struct Crack {
  TileId tile, other;                   // `other`: across the side, or a child of `tile` on it
  std::array<Eigen::Vector3d, 2> ends;  // nav [m]
};

struct BorderReport {
  std::uint64_t tiles = 0, pairs = 0;  // pairs: neighbours of the same or different levels, compared
  std::uint64_t segments = 0;          // that both tiles of a pair have, to the last bit
  std::uint64_t ends = 0;              // that one has where the other has nothing: the data end at the side
  std::uint64_t off_lattice = 0;       // vertices that are not on TileGrid's lattice
  std::uint64_t crack_count = 0;
  std::vector<Crack> cracks;  // the first kMostCracks of them
  static constexpr std::size_t kMostCracks = 100;
};

// Whether tiles join without cracks: along the side between two tiles, of whatever levels, the borders of
// both meshes must be the same segments, run through in opposite directions. A border is taken with its
// direction and added up over the faces, so that what meets itself inside a tile counts for nothing, and
// doubled vertices (at seams of the texture) do not matter; TileMesh::shared is not used.
//
// A segment that only one tile has is a crack where the other has a segment of its own beside it (overlapping
// along the side by more than two steps of the lattice, no farther in depth than two voxels or the longer
// one's length), and the end of the data otherwise. What that leaves open is closed by the second rule: along
// its sides a tile has exactly the segments of its children, so that it ends where the finest level does.
class BorderCheck {
 public:
  explicit BorderCheck(const TileGrid& grid) : grid_(grid) {}

  // Keeps the segments on the tile's sides only. A tile that was added before is replaced.
  void add(const TileMesh& tile);
  // Compares each tile with all those across its sides and with its children.
  [[nodiscard]] BorderReport run() const;

 private:
  using Place = std::array<std::int32_t, 3>;  // steps of the lattice
  struct Segment {
    Place from, to;    // from < to
    std::int32_t net;  // times that faces run through it from `from` to `to`, less the opposite direction
  };
  static constexpr std::size_t kSides = 4;  // low north, high north, low east, high east
  using Sides = std::array<std::vector<Segment>, kSides>;

  void compare(const TileId& tile, std::size_t side, const TileId& other, BorderReport& report) const;
  void compareWithChildren(const TileId& tile, BorderReport& report) const;
  [[nodiscard]] std::vector<Segment> within(const std::vector<Segment>& all, std::size_t axis,
                                            const TileId& tile) const;
  void note(const TileId& tile, const TileId& other, const Segment& segment, BorderReport& report) const;

  TileGrid grid_;
  std::map<TileId, Sides> tiles_;
  std::uint64_t off_lattice_ = 0;
};

}  // namespace fathom::test
