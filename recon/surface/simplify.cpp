#include "recon/surface/simplify.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "recon/surface/decimation.hpp"
#include "recon/surface/surface_error.hpp"

namespace fathom::surface {
namespace {

// Least share of the wanted triangles for the inside of a tile, where its border needs more than the rest.
constexpr double kLeastInside = 0.5;

struct PlacedVertex {
  std::array<std::uint32_t, 3> place;
  std::uint32_t tile, vertex;
  auto operator<=>(const PlacedVertex&) const = default;
};

template <typename T>
void follow(std::vector<T>& into, const std::vector<T>& from, std::size_t vertex, bool kept) {
  if (kept) into.push_back(from[vertex]);
}

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
    // Errors are stated to a step of the lattice.
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

std::uint8_t sidesOf(const Eigen::Vector3f& point, const TileGrid& grid, const TileId& tile) {
  const std::array<double, 4> box = grid.box(tile);
  const auto on = [](float value, double plane) {
    return static_cast<double>(value) == TileGrid::snap(plane);
  };
  unsigned sides = 0;
  if (on(point.x(), box[0])) sides |= kLowNorth;
  if (on(point.x(), box[2])) sides |= kHighNorth;
  if (on(point.y(), box[1])) sides |= kLowEast;
  if (on(point.y(), box[3])) sides |= kHighEast;
  return static_cast<std::uint8_t>(sides);
}

TileMesh joinTiles(const std::vector<const TileMesh*>& tiles, const TileGrid& grid, const TileId& into) {
  std::vector<PlacedVertex> placed;
  for (std::uint32_t i = 0; i < tiles.size(); ++i)
    for (std::uint32_t v = 0; v < tiles[i]->mesh.vertices.size(); ++v)
      placed.push_back({bitsOf(tiles[i]->mesh.vertices[v]), i, v});
  std::sort(placed.begin(), placed.end());

  // An attribute is kept when all tiles with vertices have it.
  const auto all = [&](const auto& has) {
    return std::all_of(tiles.begin(), tiles.end(),
                       [&](const TileMesh* t) { return t->mesh.vertices.empty() || has(*t); });
  };
  const bool normals = all([](const TileMesh& t) { return !t.mesh.normals.empty(); });
  const bool colours = all([](const TileMesh& t) { return !t.mesh.colours.empty(); });
  const bool sigma = all([](const TileMesh& t) { return !t.mesh.sigma.empty(); });
  const bool views = all([](const TileMesh& t) { return !t.views.empty(); });

  TileMesh out;
  out.tile = into;
  constexpr std::uint32_t kNone = 0xFFFFFFFF;
  std::vector<std::vector<std::uint32_t>> first_there(tiles.size()), number(tiles.size());
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    first_there[i].assign(tiles[i]->mesh.vertices.size(), kNone);
    number[i].assign(tiles[i]->mesh.vertices.size(), kNone);
  }
  // The first of the vertices at one place represents all of them and is numbered before the others.
  for (std::size_t first = 0, last = 0; first < placed.size(); first = last) {
    while (last < placed.size() && placed[last].place == placed[first].place) ++last;
    for (std::size_t k = first + 1; k < last; ++k)
      first_there[placed[k].tile][placed[k].vertex] = static_cast<std::uint32_t>(first);
  }
  for (std::uint32_t i = 0; i < tiles.size(); ++i) {
    const TileMesh& tile = *tiles[i];
    for (std::uint32_t v = 0; v < tile.mesh.vertices.size(); ++v) {
      if (first_there[i][v] != kNone) {
        const PlacedVertex& first = placed[first_there[i][v]];
        number[i][v] = number[first.tile][first.vertex];
        continue;
      }
      number[i][v] = static_cast<std::uint32_t>(out.mesh.vertices.size());
      out.mesh.vertices.push_back(tile.mesh.vertices[v]);
      const bool border = !tile.shared.empty() && tile.shared[v] != 0;
      out.shared.push_back(border ? sidesOf(tile.mesh.vertices[v], grid, into) : 0);
      follow(out.mesh.normals, tile.mesh.normals, v, normals);
      follow(out.mesh.colours, tile.mesh.colours, v, colours);
      follow(out.mesh.sigma, tile.mesh.sigma, v, sigma);
      follow(out.views, tile.views, v, views);
    }
    for (const auto& t : tile.mesh.triangles)
      out.mesh.triangles.push_back({number[i][t[0]], number[i][t[1]], number[i][t[2]]});
    out.error = std::max(out.error, tile.error);
  }
  return out;
}

}  // namespace fathom::surface
