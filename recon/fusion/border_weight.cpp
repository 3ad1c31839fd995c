#include "recon/fusion/border_weight.hpp"

#include <algorithm>
#include <cstdint>
#include <queue>
#include <utility>

namespace fathom::fusion {
namespace {

// At the border a mesh still counts where nothing else was seen.
constexpr float kFloor = 0.05F;

}  // namespace

std::vector<float> borderWeights(const Mesh& mesh, double width) {
  // Undirected edges as sorted pairs: one that occurs once is border.
  std::vector<std::uint64_t> edges;
  edges.reserve(mesh.triangles.size() * 3);
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [a, b] = std::minmax(t[k], t[(k + 1) % 3]);
      edges.push_back(std::uint64_t{a} << 32 | b);
    }
  std::sort(edges.begin(), edges.end());

  const std::size_t n = mesh.vertices.size();
  const float far = static_cast<float>(width);
  std::vector<float> distance(n, far);
  std::vector<std::uint32_t> first(n + 1, 0);  // neighbours in compressed rows
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unique;
  unique.reserve(edges.size() / 2);
  for (std::size_t k = 0; k < edges.size();) {
    std::size_t next = k;
    while (next < edges.size() && edges[next] == edges[k]) ++next;
    const auto a = static_cast<std::uint32_t>(edges[k] >> 32), b = static_cast<std::uint32_t>(edges[k]);
    unique.emplace_back(a, b);
    ++first[a + 1];
    ++first[b + 1];
    if (next - k == 1) distance[a] = distance[b] = 0;
    k = next;
  }
  for (std::size_t v = 0; v < n; ++v) first[v + 1] += first[v];
  std::vector<std::uint32_t> neighbour(unique.size() * 2), fill(first.begin(), first.end() - 1);
  for (const auto& [a, b] : unique) {
    neighbour[fill[a]++] = b;
    neighbour[fill[b]++] = a;
  }

  // Dijkstra from the border, no further than the width.
  using Entry = std::pair<float, std::uint32_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  for (std::uint32_t v = 0; v < n; ++v)
    if (distance[v] == 0) queue.emplace(0.0F, v);
  while (!queue.empty()) {
    const auto [d, v] = queue.top();
    queue.pop();
    if (d > distance[v]) continue;
    for (std::uint32_t k = first[v]; k < first[v + 1]; ++k) {
      const std::uint32_t u = neighbour[k];
      const float through = d + (mesh.vertices[u] - mesh.vertices[v]).norm();
      if (through < distance[u]) {
        distance[u] = through;
        queue.emplace(through, u);
      }
    }
  }
  for (float& d : distance) d = std::max(kFloor, d / far);
  return distance;
}

}  // namespace fathom::fusion
