#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/tile_mesh.hpp"

namespace fathom::fusion {

class CellStatistics;

// The part of the model that a fusion builds.
struct FusionBounds {
  TileGrid grid;   // with the fusion's voxel
  TileRange core;  // leaf tiles to build
};

struct VolumetricConfig {
  double voxel = 0.033;      // edge [m]
  double truncation = 0.10;  // band of signed distance on either side of the surface [m]
  int min_observations = 1;  // meshes that must have seen a voxel
  double border = 0.15;      // weights fall to the mesh's border over this distance [m]
  bool carve = true;         // empties voxels that a mesh was seen through: removes fish and ghosts
  double min_area = 0.05;    // of loose parts that extractTiles() keeps at any extent [m^2]
  // Width around the core in which voxels are kept and parts are traced [m]. A part of half this size is
  // never dropped, so that all pieces with some of it decide alike.
  double overlap = 1.5;
  std::optional<FusionBounds> bounds = std::nullopt;  // none: everything is kept
  // Deviation between all meshes of the model (not only those within the bounds); null: not known. Must
  // outlive the fusion.
  const CellStatistics* statistics = nullptr;
  bool baseline_kernels = false;  // uses the baseline instruction set; the result is the same
};

// Volumetric fusion of range meshes: cumulative weighted signed distance along the lines of sight in a hashed
// grid of 8^3 blocks, surface by marching cubes. After Curless & Levoy, SIGGRAPH 1996, equations 1 and 2;
// weights are the cosine of incidence over the variance, falling towards the mesh's edge and behind the
// surface. The variance is that of the points, from their sigma (which grows with the range), and between
// them that of a random walk with the slopes around: on rough ground the variance is least at the points.
//
// The ramp follows the data's own spread: it is `truncation` wide, or three times the sigma of the points or
// the deviation between meshes where that is more (at most three times `truncation`). State: 16 bytes a
// voxel, 8 KiB a block; a surface of A m^2 takes about A / (8 voxel)^2 * (1 + (2 truncation + voxel) / (8
// voxel)) blocks, at the defaults some 0.25 MB a square metre. One thread at a time; the result depends on
// the order of the meshes only through rounding.
//
// A model in pieces: two fusions with different bounds, given the meshes that reach into their cores grown by
// the overlap, in the same order, hold the same bits in the voxels in or near both cores.
class VolumetricFusion {
 public:
  explicit VolumetricFusion(const VolumetricConfig& config);  // throws std::invalid_argument
  ~VolumetricFusion();

  // Fuses a mesh seen from `camera_centre`, both in nav; with sigma (without: half a voxel) and optional
  // colours. Every line of sight meets it at most once, as in a triangulation of the image. Triangles that
  // face away, are not finite, or are longer than kMaxEdge are skipped and counted. Changes voxels up to
  // reach() from the plan box of the mesh's vertices.
  void integrate(const Mesh& mesh, const Eigen::Vector3d& camera_centre);
  [[nodiscard]] double reach() const;  // [m]

  // The fused surface in nav, with normals (towards the cameras), colours, sigma. In the order of the blocks'
  // positions. With bounds it includes the overlap, where it can be incomplete.
  [[nodiscard]] Mesh extract() const;

  // The surface by leaf tiles of `grid`, those of the core (without bounds: all) grown by `halo` tiles on
  // each side, that are not empty; ascending. A cell of the voxel grid belongs to the tile of its low corner.
  // Vertices are on TileGrid's lattice, no two at one place, no triangle is degenerate; normals include the
  // neighbours' triangles. A tile does not depend on the bounds. Loose parts smaller than half the overlap in
  // every direction and less than `min_area` are left out. The halo's tiles are for tests of visibility;
  // their far sides can be cut off. Throws std::invalid_argument for a grid of another voxel, tiles that are
  // not a whole number of blocks, and voxels finer than eight steps of the lattice.
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
