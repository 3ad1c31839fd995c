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
};

// Volumetric fusion of range meshes: cumulative weighted signed distance along the lines of sight in a hashed
// grid of 8^3 blocks, surface by marching cubes. After Curless & Levoy, SIGGRAPH 1996, equations 1 and 2;
// weights from each vertex's sigma and falling towards the mesh's edge.
class VolumetricFusion {
 public:
  explicit VolumetricFusion(const VolumetricConfig& config);  // throws std::invalid_argument
  ~VolumetricFusion();

  // `mesh`: seen from `camera_centre`, both in nav; with sigma, and colours where they should be fused.
  void integrate(const Mesh& mesh, const Eigen::Vector3d& camera_centre);

  // The fused surface in nav, with normals, colours, sigma.
  [[nodiscard]] Mesh extract() const;
  [[nodiscard]] std::size_t memoryBytes() const;  // of all blocks and the index

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::fusion
