#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/tile_grid.hpp"
#include "recon/geometry/tile_mesh.hpp"

namespace fathom::fusion {

class CellStatistics;

// The part of the model that a fusion is for.
struct FusionBounds {
  TileGrid grid;   // its voxel is the fusion's
  TileRange core;  // leaf tiles that are made
};

struct VolumetricConfig {
  double voxel = 0.033;      // edge [m]
  double truncation = 0.10;  // band of signed distance on either side of the surface [m]
  int min_observations = 1;  // meshes that must have seen a voxel
  double border = 0.15;      // weights fall to the mesh's border over this distance [m]
  bool carve = true;         // what a mesh was seen through is empty: removes fish and ghosts
  double min_area = 0.05;    // of loose parts that extractTiles() keeps, whatever their size [m^2]
  // Around the core, in which voxels are kept and parts are followed [m]. A part of half this size is never
  // dropped, so that every piece that sees some of it judges alike.
  double overlap = 1.5;
  std::optional<FusionBounds> bounds = std::nullopt;  // none: everything is kept
  // How far meshes disagree, of all that is fused (not only of what these bounds see); null: not known. Must
  // stay as long as the fusion.
  const CellStatistics* statistics = nullptr;
  bool baseline_kernels = false;  // not the processor's widest registers; the result is the same
};

// Volumetric fusion of range meshes: cumulative weighted signed distance along the lines of sight in a hashed
// grid of 8^3 blocks, surface by marching cubes. After Curless & Levoy, SIGGRAPH 1996, equations 1 and 2;
// weights are the cosine of incidence over the variance, falling towards the mesh's edge and behind the
// surface. The variance is that of the points, from their sigma (which grows with the range), and between
// them that of a random walk with the slopes around: rough ground is known best where the points are.
//
// The ramp follows the data's own spread: it is `truncation` wide, or three times the sigma of the points or
// the deviation between meshes where that is more (at most three times `truncation`). State: 16 bytes a
// voxel, 8 KiB a block; a surface of A m^2 takes about A / (8 voxel)^2 * (1 + (2 truncation + voxel) / (8
// voxel)) blocks, at the defaults some 0.25 MB a square metre. One thread at a time; the result depends on
// the order of the meshes only through rounding.
//
// A model made in pieces: two fusions whose bounds differ, given the meshes that reach into their cores grown
// by the overlap, in the same order, hold the same bits in the voxels that their cores share or have near.
class VolumetricFusion {
 public:
  explicit VolumetricFusion(const VolumetricConfig& config);  // throws std::invalid_argument
  ~VolumetricFusion();

  // `mesh`: seen from `camera_centre`, both in nav; with sigma (without: half a voxel), and colours where
  // they should be fused. Every line of sight meets it once, as it does a triangulation of the image.
  // Triangles that face away, are not finite, or reach beyond kMaxEdge are skipped and counted. Changes
  // voxels no further than reach() from the box of the mesh's vertices in plan.
  void integrate(const Mesh& mesh, const Eigen::Vector3d& camera_centre);
  [[nodiscard]] double reach() const;  // [m]

  // The fused surface in nav, with normals (towards the cameras), colours, sigma. In the order of the blocks'
  // positions. With bounds: their overlap included, where it need not be whole.
  [[nodiscard]] Mesh extract() const;

  // The surface by leaf tiles of `grid`, those of the core (without bounds: all) grown by `halo` tiles on
  // each side, that are not empty; ascending. A cell of the voxel grid belongs to the tile of its low corner.
  // Vertices stand on TileGrid's lattice, no two at one place, none of the triangles degenerate; normals take
  // the neighbours' triangles in. What a tile is does not depend on the bounds. Loose parts smaller than
  // half the overlap in every direction and less than `min_area` are left out. The halo's tiles are for
  // looking at (what hides what); their far sides may be cut off. Throws std::invalid_argument: a grid of
  // another voxel, tiles that are no whole number of blocks, voxels finer than eight steps of the lattice.
  [[nodiscard]] std::vector<TileMesh> extractTiles(const TileGrid& grid, int halo = 0) const;

  [[nodiscard]] std::size_t memoryBytes() const;  // of all blocks and the index

  struct Counters {
    std::uint64_t meshes = 0, triangles = 0, skipped_triangles = 0, voxel_updates = 0, carved_voxels = 0;
    std::size_t blocks = 0;
  };
  [[nodiscard]] Counters counters() const;

  static constexpr double kMaxEdge = 256;  // longest triangle edge, in voxels
  static constexpr double kMaxBand = 3;    // widest ramp, in truncations

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::fusion
