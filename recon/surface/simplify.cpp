#include "recon/surface/simplify.hpp"

#include <algorithm>
#include <cmath>

#include "recon/surface/decimation.hpp"
#include "recon/surface/surface_error.hpp"

namespace fathom::surface {
namespace {

// Of the triangles asked for, what is left to the inside of a tile whose border takes the rest or more.
constexpr double kLeastInside = 0.5;

}  // namespace

TileMesh simplify(const TileMesh& tile, double triangles_per_m2, SimplifyCounts* counts) {
  SimplifyCounts own;
  Decimation decimation(tile, own);
  const double wanted = std::max(0.0, triangles_per_m2 * decimation.area());
  const double target =
      std::max(wanted, static_cast<double>(decimation.borderEdges()) + kLeastInside * wanted);
  decimation.run(static_cast<std::size_t>(std::ceil(target)));
  TileMesh out = decimation.result();
  if (own.collapses + own.closed > 0) {
    // A step of the lattice is the least that an error can be stated to.
    const double there = distanceBound(tile.mesh, out.mesh, TileGrid::kLattice);
    const double back = distanceBound(out.mesh, tile.mesh, TileGrid::kLattice);
    out.error += std::max(there, back);
  }
  if (counts != nullptr) {
    counts->collapses += own.collapses;
    counts->pinned += own.pinned;
    counts->closed += own.closed;
    counts->stranded += own.stranded;
  }
  return out;
}

}  // namespace fathom::surface
