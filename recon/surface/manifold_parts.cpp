#include "recon/surface/manifold_parts.hpp"

#include <algorithm>
#include <numeric>

namespace fathom::surface {
namespace {

constexpr std::uint32_t kNone = 0xFFFFFFFF;

// Corners (3 * triangle + k) that are the same vertex of one fan.
class Fans {
 public:
  explicit Fans(std::size_t corners) : parent_(corners) {
    std::iota(parent_.begin(), parent_.end(), std::uint32_t{0});
  }
  std::uint32_t find(std::uint32_t corner) {
    while (parent_[corner] != corner) corner = parent_[corner] = parent_[parent_[corner]];
    return corner;
  }
  void unite(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

struct HalfEdge {
  std::uint64_t key;   // the lower vertex, then the higher
  std::uint32_t from;  // corner at the edge's start; its end is the triangle's next corner
};

std::uint32_t nextCorner(std::uint32_t corner) {
  return corner % 3 == 2 ? corner - 2 : corner + 1;
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
  std::vector<HalfEdge> edges(corners);
  for (std::uint32_t c = 0; c < corners; ++c) {
    const std::uint64_t a = vertexAt(c), b = vertexAt(nextCorner(c));
    edges[c] = {std::min(a, b) << 32 | std::max(a, b), c};
  }
  std::sort(edges.begin(), edges.end(), [](const HalfEdge& a, const HalfEdge& b) {
    return a.key != b.key ? a.key < b.key : a.from < b.from;
  });

  Fans fans(corners);
  std::vector<std::uint8_t> cut(vertices, 0);
  for (std::size_t first = 0, last = 0; first < edges.size(); first = last) {
    while (last < edges.size() && edges[last].key == edges[first].key) ++last;
    const std::uint32_t c = edges[first].from;
    if (last - first == 2 && vertexAt(c) != vertexAt(edges[first + 1].from)) {
      const std::uint32_t d = edges[first + 1].from;
      fans.unite(c, nextCorner(d));
      fans.unite(nextCorner(c), d);
    } else if (last - first > 1) {
      ++parts.cut_edges;
      cut[vertexAt(c)] = cut[vertexAt(nextCorner(c))] = 1;
    }
  }

  std::vector<std::uint32_t> fan_of(corners, kNone), fans_at(vertices, 0);
  for (std::uint32_t c = 0; c < corners; ++c) {
    const std::uint32_t root = fans.find(c);
    if (fan_of[root] == kNone) {
      fan_of[root] = static_cast<std::uint32_t>(parts.original.size());
      parts.original.push_back(vertexAt(c));
      if (++fans_at[vertexAt(c)] == 2) ++parts.split_vertices;
    }
  }
  for (const std::uint32_t v : parts.original) parts.pinned.push_back(cut[v] != 0 || fans_at[v] > 1 ? 1 : 0);
  std::vector<std::array<std::uint32_t, 3>> joined(parts.triangles.size());
  for (std::uint32_t c = 0; c < corners; ++c) joined[c / 3][c % 3] = fan_of[fans.find(c)];
  parts.triangles = std::move(joined);
  return parts;
}

}  // namespace fathom::surface
