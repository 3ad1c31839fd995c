#pragma once

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::test {

struct Topology {
  std::size_t vertices = 0, edges = 0, faces = 0;
  std::size_t border_edges = 0, bad_edges = 0;  // of one face; of more than two, or of faces that disagree
  std::size_t components = 0;
  [[nodiscard]] long euler() const {
    return static_cast<long>(vertices) - static_cast<long>(edges) + static_cast<long>(faces);
  }
};

inline Topology topologyOf(const Mesh& mesh) {
  Topology out;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::pair<int, int>> edges;
  std::vector<std::uint32_t> part(mesh.vertices.size());
  for (std::uint32_t v = 0; v < part.size(); ++v) part[v] = v;
  const auto find = [&](std::uint32_t v) {
    while (part[v] != v) v = part[v] = part[part[v]];
    return v;
  };
  std::set<std::uint32_t> used;
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      used.insert(a);
      part[find(a)] = find(b);
      ++(a < b ? edges[{a, b}].first : edges[{b, a}].second);
    }
  out.vertices = used.size();
  out.edges = edges.size();
  out.faces = mesh.triangles.size();
  for (const auto& [key, n] : edges) {
    if (n.first + n.second == 1) ++out.border_edges;
    if (n.first > 1 || n.second > 1) ++out.bad_edges;
  }
  for (const std::uint32_t v : used)
    if (find(v) == v) ++out.components;
  return out;
}

}  // namespace fathom::test
