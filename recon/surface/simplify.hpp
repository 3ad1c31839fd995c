#pragma once

#include <vector>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::surface {

// Joins tiles (children of one parent, or any neighbours) into `into`: vertices that they share become one,
// and stay `shared` only where they lie on a side of `into`.
[[nodiscard]] TileMesh joinTiles(const std::vector<const TileMesh*>& tiles, const TileGrid& grid,
                                 const TileId& into);

// Fewer triangles by quadric error (Garland & Heckbert 1998; OpenMesh), down to `triangles_per_m2` of the
// surface's area. Shared vertices and the edges between them stay as they are; no face flips, none
// degenerates; topology is kept. Positions stay on TileGrid's lattice. Normals are new; sigma, views and
// colours follow. `error` grows by the greatest distance of a removed vertex from the new surface. Whatever
// cannot be reached without breaking these rules is left.
[[nodiscard]] TileMesh simplify(const TileMesh& tile, double triangles_per_m2);

}  // namespace fathom::surface
