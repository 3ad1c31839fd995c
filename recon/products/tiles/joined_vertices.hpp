#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "realtime/base/numbers/hash64.hpp"
#include "recon/geometry/tile_mesh.hpp"

namespace fathom::topside {

// Numbers for the vertices of tiles that come in ascending order (x, then y): one for each place. Keeps the
// border of the row of tiles at hand and of the one before.
class JoinedVertices {
 public:
  struct Numbers {
    std::vector<std::uint64_t> of_vertex;  // a vertex of the tile: its number in the whole model
    std::vector<std::uint32_t> added;      // vertices that are new there, ascending numbers
  };
  [[nodiscard]] Numbers add(const TileMesh& tile);
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  using Place = std::array<float, 3>;
  struct Hash {
    std::size_t operator()(const Place& place) const;
  };
  using Known = std::unordered_map<Place, std::uint64_t, Hash>;

  Known row_, next_row_;  // on borders of this row of tiles; of those, what the next row shares
  Known last_row_;
  std::int32_t x_ = 0;
  std::uint64_t count_ = 0;
};

}  // namespace fathom::topside
