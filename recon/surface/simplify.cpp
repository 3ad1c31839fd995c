#include "recon/surface/simplify.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/union_find.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/surface/decimation.hpp"
#include "recon/surface/surface_error.hpp"

namespace fathom::surface {
namespace {

constexpr std::uint32_t kNoFan = 0xFFFFFFFF;

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

ManifoldParts manifoldParts(const std::vector<std::array<std::uint32_t, 3>>& triangles,
                            std::size_t vertices) {
  ManifoldParts parts;
  for (const auto& t : triangles)
    if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) parts.triangles.push_back(t);
  parts.dropped_triangles = triangles.size() - parts.triangles.size();

  const auto corners = static_cast<std::uint32_t>(3 * parts.triangles.size());
  const auto vertexAt = [&](std::uint32_t corner) { return parts.triangles[corner / 3][corner % 3]; };
  UnionFind fans(corners);  // corners that are the same vertex of one fan
  std::vector<std::uint8_t> cut(vertices, 0);
  visitEdges(parts.triangles, [&](const std::vector<std::uint32_t>& sides) {
    const std::uint32_t c = sides[0];
    if (sides.size() == 2 && vertexAt(c) != vertexAt(sides[1])) {
      fans.join(c, nextCorner(sides[1]));
      fans.join(nextCorner(c), sides[1]);
    } else if (sides.size() > 1) {
      ++parts.cut_edges;
      cut[vertexAt(c)] = cut[vertexAt(nextCorner(c))] = 1;
    }
  });

  std::vector<std::uint32_t> fan_of(corners, kNoFan), fans_at(vertices, 0);
  for (std::uint32_t c = 0; c < corners; ++c) {
    const std::uint32_t root = fans.root(c);
    if (fan_of[root] == kNoFan) {
      fan_of[root] = static_cast<std::uint32_t>(parts.original.size());
      parts.original.push_back(vertexAt(c));
      if (++fans_at[vertexAt(c)] == 2) ++parts.split_vertices;
    }
  }
  for (const std::uint32_t v : parts.original) parts.pinned.push_back(cut[v] != 0 || fans_at[v] > 1 ? 1 : 0);
  std::vector<std::array<std::uint32_t, 3>> joined(parts.triangles.size());
  for (std::uint32_t c = 0; c < corners; ++c) joined[c / 3][c % 3] = fan_of[fans.root(c)];
  parts.triangles = std::move(joined);
  return parts;
}

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
