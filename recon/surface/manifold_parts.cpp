#include "recon/surface/manifold_parts.hpp"

#include "realtime/base/numbers/union_find.hpp"
#include "recon/geometry/triangles.hpp"

namespace fathom::surface {
namespace {

constexpr std::uint32_t kNoFan = 0xFFFFFFFF;

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

}  // namespace fathom::surface
