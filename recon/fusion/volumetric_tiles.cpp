#include <cmath>
#include <map>
#include <stdexcept>

#include "recon/fusion/surface_extraction.hpp"
#include "recon/fusion/volumetric_impl.hpp"
#include "recon/geometry/union_find.hpp"

namespace fathom::fusion {
namespace {

constexpr int kEdge = VoxelBlock::kEdge;
constexpr std::uint32_t kNone = 0xFFFFFFFF;

// For each triangle whether its part is smaller than `size` along every axis and less than `area`.
std::vector<bool> smallParts(const Mesh& mesh, double size, double area) {
  struct Extent {
    Eigen::Vector3f low = Eigen::Vector3f::Constant(INFINITY), high = -low;
    double area = 0;
  };
  UnionFind parts(mesh.vertices.size());
  for (const auto& t : mesh.triangles) {
    parts.join(t[0], t[1]);
    parts.join(t[0], t[2]);
  }
  std::vector<std::uint32_t> number(mesh.vertices.size(), kNone);
  std::vector<Extent> extents;
  std::vector<std::uint32_t> part_of(mesh.triangles.size());
  for (std::size_t k = 0; k < mesh.triangles.size(); ++k) {
    const auto& [a, b, c] = mesh.triangles[k];
    std::uint32_t& part = number[parts.root(a)];
    if (part == kNone) {
      part = static_cast<std::uint32_t>(extents.size());
      extents.emplace_back();
    }
    part_of[k] = part;
    Extent& extent = extents[part];
    for (const std::uint32_t v : {a, b, c}) {
      extent.low = extent.low.cwiseMin(mesh.vertices[v]);
      extent.high = extent.high.cwiseMax(mesh.vertices[v]);
    }
    const Eigen::Vector3f ab = mesh.vertices[b] - mesh.vertices[a], ac = mesh.vertices[c] - mesh.vertices[a];
    extent.area += 0.5 * static_cast<double>(ab.cross(ac).norm());
  }
  std::vector<bool> small(mesh.triangles.size());
  for (std::size_t k = 0; k < small.size(); ++k) {
    const Extent& extent = extents[part_of[k]];
    small[k] = extent.area < area && static_cast<double>((extent.high - extent.low).maxCoeff()) < size;
  }
  return small;
}

int floorDiv(int a, int b) {
  return a >= 0 ? a / b : -((-a + b - 1) / b);
}

// Takes the triangles of one tile out of a surface.
class TileCut {
 public:
  TileCut(const ExtractedSurface& surface, int blocks)
      : surface_(surface), blocks_(blocks), taken_(surface.mesh.vertices.size()) {}

  TileMesh cut(const TileId& id, const std::vector<std::uint32_t>& parts, const std::vector<bool>& left_out) {
    ++turn_;
    TileMesh out;
    out.tile = id;
    const auto& triangles = surface_.mesh.triangles;
    for (const std::uint32_t part : parts) {
      const std::size_t end =
          part + 1 < surface_.parts.size() ? surface_.parts[part + 1].first_triangle : triangles.size();
      for (std::size_t k = surface_.parts[part].first_triangle; k < end; ++k)
        if (!left_out[k])
          out.mesh.triangles.push_back(
              {take(triangles[k][0], out), take(triangles[k][1], out), take(triangles[k][2], out)});
    }
    return out;
  }

 private:
  std::uint32_t take(std::uint32_t v, TileMesh& out) {
    if (taken_[v].turn == turn_) return taken_[v].as;
    taken_[v] = {turn_, static_cast<std::uint32_t>(out.mesh.vertices.size())};
    out.mesh.vertices.push_back(surface_.mesh.vertices[v]);
    out.mesh.normals.push_back(surface_.mesh.normals[v]);
    out.mesh.colours.push_back(surface_.mesh.colours[v]);
    out.mesh.sigma.push_back(surface_.mesh.sigma[v]);
    out.views.push_back(surface_.views[v]);
    const BlockKey& home = surface_.parts[surface_.home[v]].block;
    unsigned sides = 0;
    if ((surface_.planes[v] & 1) != 0) {
      if (home.x == out.tile.x * blocks_) sides |= kLowNorth;
      if (home.x == (out.tile.x + 1) * blocks_) sides |= kHighNorth;
    }
    if ((surface_.planes[v] & 2) != 0) {
      if (home.y == out.tile.y * blocks_) sides |= kLowEast;
      if (home.y == (out.tile.y + 1) * blocks_) sides |= kHighEast;
    }
    out.shared.push_back(static_cast<std::uint8_t>(sides));
    return taken_[v].as;
  }

  const ExtractedSurface& surface_;
  int blocks_;  // along a tile's side
  struct Taken {
    std::uint32_t turn = 0, as = 0;  // in which cut, as which vertex
  };
  std::vector<Taken> taken_;
  std::uint32_t turn_ = 0;
};

}  // namespace

Mesh VolumetricFusion::extract() const {
  const VolumetricConfig& config = impl_->config;
  return extractSurface(impl_->grid, {config.voxel, config.min_observations, false}).mesh;
}

std::vector<TileMesh> VolumetricFusion::extractTiles(const TileGrid& grid, int halo) const {
  constexpr double kLeastSteps = 8;  // of the lattice a voxel: room for a vertex inside its edges
  const VolumetricConfig& config = impl_->config;
  if (grid.voxel != config.voxel) throw std::invalid_argument("fusion: tiles of another voxel");
  if (grid.leaf_voxels < kEdge || grid.leaf_voxels % kEdge != 0)
    throw std::invalid_argument("fusion: tiles are to be a multiple of 8 voxels wide");
  if (config.voxel < kLeastSteps * TileGrid::kLattice)
    throw std::invalid_argument("fusion: voxels of tiles are to be at least 0.0039 m");
  const ExtractedSurface surface = extractSurface(impl_->grid, {config.voxel, config.min_observations, true});
  const std::vector<bool> left_out = smallParts(surface.mesh, config.overlap / 2, config.min_area);

  const int blocks = grid.leaf_voxels / kEdge;
  std::map<TileId, std::vector<std::uint32_t>> parts_of;
  for (std::uint32_t k = 0; k < surface.parts.size(); ++k) {
    const BlockKey& key = surface.parts[k].block;
    const TileId tile{0, floorDiv(key.x, blocks), floorDiv(key.y, blocks)};
    if (config.bounds) {
      const TileRange& core = config.bounds->core;
      const TileRange wanted{core.x0 - halo, core.y0 - halo, core.x1 + halo, core.y1 + halo};
      if (!wanted.contains(tile)) continue;
    }
    parts_of[tile].push_back(k);
  }
  std::vector<TileMesh> out;
  TileCut cutter(surface, blocks);
  for (const auto& [tile, parts] : parts_of) {
    TileMesh mesh = cutter.cut(tile, parts, left_out);
    if (!mesh.mesh.empty()) out.push_back(std::move(mesh));
  }
  return out;
}

}  // namespace fathom::fusion
