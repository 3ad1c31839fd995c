#include "recon/fusion/border_weight.hpp"

#include <algorithm>
#include <cstdint>

namespace fathom::fusion {
namespace {

// At the border a mesh still counts where nothing else was seen.
constexpr float kFloor = 0.05F;

// The neighbours of each vertex, twice where two triangles have the edge, in compressed rows.
struct Neighbours {
  std::vector<std::uint32_t> first, vertex;

  explicit Neighbours(const Mesh& mesh) : first(mesh.vertices.size() + 2, 0) {
    for (const auto& t : mesh.triangles)
      for (const std::uint32_t v : t) first[v + 2] += 2;
    for (std::size_t v = 2; v < first.size(); ++v) first[v] += first[v - 1];
    vertex.resize(mesh.triangles.size() * 6);
    for (const auto& [a, b, c] : mesh.triangles) {  // first[v + 1] is where the next neighbour of v goes
      for (const auto& [v, u, w] : {std::array{a, b, c}, std::array{b, c, a}, std::array{c, a, b}}) {
        vertex[first[v + 1]++] = u;
        vertex[first[v + 1]++] = w;
      }
    }
  }
};

}  // namespace

std::vector<float> borderWeights(const Mesh& mesh, double width) {
  const std::size_t n = mesh.vertices.size();
  const auto far = static_cast<float>(width);
  const Neighbours near(mesh);
  std::vector<float> distance(n, far);
  std::vector<std::uint32_t> reached;
  for (std::uint32_t v = 0; v < n; ++v) {
    // A border vertex has a neighbour that only one triangle gives it.
    const auto begin = near.vertex.begin() + near.first[v], end = near.vertex.begin() + near.first[v + 1];
    if (std::any_of(begin, end, [&](std::uint32_t u) { return std::count(begin, end, u) == 1; })) {
      distance[v] = 0;
      reached.push_back(v);
    }
  }
  // Shortest ways along edges from the border, no further than the width: whatever became nearer passes it
  // on. The lengths are sums in the ways' order, so the result is the same in whichever order this is done.
  std::vector<bool> waits(n, false);
  for (std::size_t k = 0; k < reached.size(); ++k) {
    const std::uint32_t v = reached[k];
    waits[v] = false;
    for (std::uint32_t i = near.first[v]; i < near.first[v + 1]; ++i) {
      const std::uint32_t u = near.vertex[i];
      const float through = distance[v] + (mesh.vertices[u] - mesh.vertices[v]).norm();
      if (through >= distance[u]) continue;
      distance[u] = through;
      if (!waits[u]) reached.push_back(u);
      waits[u] = true;
    }
  }
  for (float& d : distance) d = std::max(kFloor, d / far);
  return distance;
}

}  // namespace fathom::fusion
