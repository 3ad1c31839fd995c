#include <algorithm>
#include <bit>
#include <cmath>

#include "recon/fusion/marching_cubes.hpp"
#include "recon/fusion/volumetric_impl.hpp"

namespace fathom::fusion {
namespace {

constexpr int kEdge = VoxelGrid::kEdge;
// Distances of neighbouring voxels differ by one voxel over the cosine of incidence. A greater step than this
// [voxels] is no surface but the seam between the back of one mesh's band and the front of another's.
constexpr float kSteepest = 4.0F;

// One bit for each edge that begins at a voxel of a block, and the number of the first vertex of each word.
struct BlockEdges {
  static constexpr int kWords = VoxelGrid::kVoxels * 3 / 64;
  std::array<std::uint64_t, kWords> used{};
  std::array<std::uint32_t, kWords> first{};

  void mark(std::size_t edge) { used[edge / 64] |= std::uint64_t{1} << (edge % 64); }
  [[nodiscard]] std::uint32_t vertex(std::size_t edge) const {
    const std::uint64_t before = used[edge / 64] & ((std::uint64_t{1} << (edge % 64)) - 1);
    return first[edge / 64] + static_cast<std::uint32_t>(std::popcount(before));
  }
};

// Blocks of the 2 x 2 x 2 neighbourhood that a block's cells reach into; number = dx + 2 dy + 4 dz.
struct Neighbourhood {
  std::array<const VoxelGrid::Block*, 8> block{};
  std::array<std::size_t, 8> order{};  // position in the sorted list

  struct Place {
    std::size_t neighbour, local;
  };
  static Place place(int x, int y, int z) {
    return {static_cast<std::size_t>((x >> 3) | (y >> 3) << 1 | (z >> 3) << 2),
            VoxelGrid::local(x & 7, y & 7, z & 7)};
  }
  [[nodiscard]] const Voxel* voxel(int x, int y, int z) const {
    const Place at = place(x, y, z);
    return block[at.neighbour] == nullptr ? nullptr : &(*block[at.neighbour])[at.local];
  }
};

class Extraction {
 public:
  explicit Extraction(const VolumetricConfig& config, const VoxelGrid& grid)
      : config_(config), grid_(grid), keys_(grid.keys()) {
    std::sort(keys_.begin(), keys_.end());
    edges_.resize(keys_.size());
  }

  Mesh run() {
    // First which edges carry a vertex, then the vertices in order, then the triangles between them.
    forEachCell([this](const Neighbourhood& near, const std::array<int, 3>& cell, unsigned signs) {
      const MarchingCubesTable::Pattern& pattern = table_.pattern(signs);
      for (std::size_t t = 0; t < pattern.triangles; ++t)
        for (const std::uint8_t e : pattern.edge[t]) {
          const auto [order, edge] = edgeOf(near, cell, e);
          edges_[order].mark(edge);
        }
    });
    makeVertices();
    forEachCell([this](const Neighbourhood& near, const std::array<int, 3>& cell, unsigned signs) {
      const MarchingCubesTable::Pattern& pattern = table_.pattern(signs);
      for (std::size_t t = 0; t < pattern.triangles; ++t) {
        std::array<std::uint32_t, 3> triangle;
        for (std::size_t k = 0; k < 3; ++k) {
          const auto [order, edge] = edgeOf(near, cell, pattern.edge[t][k]);
          triangle[k] = edges_[order].vertex(edge);
        }
        mesh_.triangles.push_back(triangle);
      }
    });
    computeNormals(mesh_);
    return std::move(mesh_);
  }

 private:
  [[nodiscard]] bool known(const Voxel* voxel) const {
    return voxel != nullptr && voxel->weight > 0 && voxel->observations >= config_.min_observations;
  }

  Neighbourhood neighbourhood(std::size_t order) const {
    Neighbourhood near;
    for (int n = 0; n < 8; ++n) {
      const BlockKey& own = keys_[order];
      const BlockKey key{own.x + (n & 1), own.y + (n >> 1 & 1), own.z + (n >> 2 & 1)};
      const auto index = static_cast<std::size_t>(n);
      near.block[index] = grid_.find(key);
      if (near.block[index] != nullptr)
        near.order[index] =
            static_cast<std::size_t>(std::lower_bound(keys_.begin(), keys_.end(), key) - keys_.begin());
    }
    return near;
  }

  // Calls visit(neighbourhood, cell, signs) for every cell that the surface crosses.
  template <typename Visit>
  void forEachCell(const Visit& visit) const {
    for (std::size_t order = 0; order < keys_.size(); ++order) {
      const Neighbourhood near = neighbourhood(order);
      for (int z = 0; z < kEdge; ++z)
        for (int y = 0; y < kEdge; ++y)
          for (int x = 0; x < kEdge; ++x) {
            unsigned signs = 0;
            if (crossed(near, x, y, z, signs)) visit(near, {x, y, z}, signs);
          }
    }
  }

  bool crossed(const Neighbourhood& near, int x, int y, int z, unsigned& signs) const {
    std::array<float, 8> d;
    signs = 0;
    for (int c = 0; c < 8; ++c) {
      const Voxel* voxel = near.voxel(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2 & 1));
      if (!known(voxel)) return false;
      d[static_cast<std::size_t>(c)] = voxel->distance;
      if (voxel->distance < 0) signs |= 1U << c;
    }
    if (signs == 0 || signs == 255) return false;
    const float steepest = kSteepest * static_cast<float>(config_.voxel);
    for (std::size_t e = 0; e < MarchingCubesTable::kEdges; ++e) {
      const auto& edge = table_.edge(e);
      const float a = d[edge.from], b = d[edge.to];
      if ((a < 0) != (b < 0) && std::abs(a - b) > steepest) return false;
    }
    return true;
  }

  struct EdgePlace {
    std::size_t order, edge;
  };
  EdgePlace edgeOf(const Neighbourhood& near, const std::array<int, 3>& cell, std::uint8_t index) const {
    const auto& edge = table_.edge(index);
    const auto at = Neighbourhood::place(cell[0] + (edge.from & 1), cell[1] + (edge.from >> 1 & 1),
                                         cell[2] + (edge.from >> 2 & 1));
    return {near.order[at.neighbour], at.local * 3 + edge.axis};
  }

  void makeVertices() {
    for (std::size_t order = 0; order < keys_.size(); ++order) {
      BlockEdges& edges = edges_[order];
      const Neighbourhood near = neighbourhood(order);
      for (std::size_t word = 0; word < BlockEdges::kWords; ++word) {
        edges.first[word] = static_cast<std::uint32_t>(mesh_.vertices.size());
        for (std::uint64_t bits = edges.used[word]; bits != 0; bits &= bits - 1)
          makeVertex(keys_[order], near, static_cast<int>(word * 64) + std::countr_zero(bits));
      }
    }
  }

  void makeVertex(const BlockKey& key, const Neighbourhood& near, int edge) {
    const int axis = edge % 3, local = edge / 3;
    const std::array<int, 3> from = {local % kEdge, local / kEdge % kEdge, local / (kEdge * kEdge)};
    std::array<int, 3> to = from;
    ++to[static_cast<std::size_t>(axis)];
    const Voxel& a = *near.voxel(from[0], from[1], from[2]);
    const Voxel& b = *near.voxel(to[0], to[1], to[2]);
    const float s = a.distance / (a.distance - b.distance);
    Eigen::Vector3d at(key.x * kEdge + from[0], key.y * kEdge + from[1], key.z * kEdge + from[2]);
    at[axis] += static_cast<double>(s);
    mesh_.vertices.push_back((at * config_.voxel).cast<float>());
    mesh_.sigma.push_back(1.0F / std::sqrt((1 - s) * a.weight + s * b.weight));
    // Colours by weight too: a voxel that hardly anything saw says little.
    const float wa = (1 - s) * a.weight, wb = s * b.weight;
    Rgb colour;
    for (std::size_t c = 0; c < 3; ++c) {
      const float mean = (wa * a.colour[c] + wb * b.colour[c]) / (wa + wb);
      colour[c] = static_cast<std::uint8_t>(std::min(255.0F, mean / 256.0F + 0.5F));
    }
    mesh_.colours.push_back(colour);
  }

  VolumetricConfig config_;
  const VoxelGrid& grid_;
  std::vector<BlockKey> keys_;
  std::vector<BlockEdges> edges_;
  MarchingCubesTable table_;
  Mesh mesh_;
};

}  // namespace

Mesh VolumetricFusion::extract() const {
  return Extraction(impl_->config, impl_->grid).run();
}

}  // namespace fathom::fusion
