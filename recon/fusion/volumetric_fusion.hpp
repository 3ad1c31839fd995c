#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>

#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

struct VolumetricConfig {
  double voxel = 0.033;      // edge [m]
  double truncation = 0.10;  // band of signed distance on either side of the surface [m]
  int min_observations = 1;  // meshes that must have seen a voxel
  double border = 0.15;      // weights fall to the mesh's border over this distance [m]
  bool carve = true;         // what a mesh was seen through is empty: removes fish and ghosts
};

// Volumetric fusion of range meshes: cumulative weighted signed distance along the lines of sight in a hashed
// grid of 8^3 blocks, surface by marching cubes. After Curless & Levoy, SIGGRAPH 1996, equations 1 and 2;
// weights from each vertex's sigma, the cosine of incidence, and falling towards the mesh's edge and behind
// the surface.
//
// The band is `truncation` wide, or three sigma where that is more (at most three times `truncation`). State:
// 16 bytes a voxel, 8 KiB a block; a surface of A m^2 takes about A / (8 voxel)^2 * (1 + (2 truncation +
// voxel) / (8 voxel)) blocks, at the defaults some 0.25 MB a square metre. One thread at a time; the result
// depends on the order of the meshes only through rounding.
class VolumetricFusion {
 public:
  explicit VolumetricFusion(const VolumetricConfig& config);  // throws std::invalid_argument
  ~VolumetricFusion();

  // `mesh`: seen from `camera_centre`, both in nav; with sigma (without: half a voxel), and colours where
  // they should be fused. Every line of sight meets it once, as it does a triangulation of the image.
  // Triangles that face away, are not finite, or reach beyond kMaxEdge are skipped and counted.
  void integrate(const Mesh& mesh, const Eigen::Vector3d& camera_centre);

  // The fused surface in nav, with normals (towards the cameras), colours, sigma. In the order of the blocks'
  // positions.
  [[nodiscard]] Mesh extract() const;
  [[nodiscard]] std::size_t memoryBytes() const;  // of all blocks and the index

  struct Counters {
    std::uint64_t meshes = 0, triangles = 0, skipped_triangles = 0, voxel_updates = 0, carved_voxels = 0;
    std::size_t blocks = 0;
  };
  [[nodiscard]] Counters counters() const;

  static constexpr double kMaxEdge = 256;  // longest triangle edge, in voxels

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::fusion
