#include "recon/topside/stages/mesh_pieces.hpp"

#include <Eigen/Geometry>
#include <numeric>

namespace fathom::topside {
namespace {

// Disjoint sets of vertices, with halving of paths.
class Pieces {
 public:
  explicit Pieces(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0U); }
  std::uint32_t find(std::uint32_t v) {
    while (parent_[v] != v) v = parent_[v] = parent_[parent_[v]];
    return v;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    if (a < b)
      parent_[b] = a;
    else
      parent_[a] = b;
  }

 private:
  std::vector<std::uint32_t> parent_;
};

template <typename T>
void compact(std::vector<T>& values, const std::vector<std::uint32_t>& new_index, std::size_t count) {
  if (values.empty()) return;
  for (std::size_t v = 0; v < new_index.size(); ++v)
    if (new_index[v] != 0xFFFFFFFF) values[new_index[v]] = values[v];
  values.resize(count);
}

}  // namespace

std::size_t dropSmallPieces(Mesh& mesh, double min_area) {
  Pieces pieces(mesh.vertices.size());
  for (const auto& [a, b, c] : mesh.triangles) {
    pieces.join(a, b);
    pieces.join(b, c);
  }
  std::vector<double> area(mesh.vertices.size(), 0);
  std::vector<bool> is_piece(mesh.vertices.size(), false);
  for (const auto& [a, b, c] : mesh.triangles) {
    const std::uint32_t root = pieces.find(a);
    is_piece[root] = true;
    area[root] +=
        0.5 * static_cast<double>(
                  (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm());
  }
  std::size_t dropped = 0;
  for (std::size_t v = 0; v < area.size(); ++v)
    if (is_piece[v] && area[v] < min_area) ++dropped;

  std::vector<std::uint32_t> new_index(mesh.vertices.size(), 0xFFFFFFFF);
  std::uint32_t count = 0;
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    const std::uint32_t root = pieces.find(v);
    if (is_piece[root] && area[root] >= min_area) new_index[v] = count++;
  }
  std::size_t kept = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    if (new_index[a] != 0xFFFFFFFF) mesh.triangles[kept++] = {new_index[a], new_index[b], new_index[c]};
  mesh.triangles.resize(kept);
  compact(mesh.vertices, new_index, count);
  compact(mesh.normals, new_index, count);
  compact(mesh.colours, new_index, count);
  compact(mesh.texture_coordinates, new_index, count);
  compact(mesh.sigma, new_index, count);
  return dropped;
}

}  // namespace fathom::topside
