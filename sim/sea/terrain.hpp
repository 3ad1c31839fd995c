#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>

#include "recon/geometry/mesh.hpp"
#include "sim/sea/terrain_config.hpp"

namespace fathom::sim {

class SurfaceScene;

// The true seafloor: triangles in nav (north, east, down, [m]) with colour, under Embree. Immutable; every
// method may be called from many threads at once.
class Terrain {
 public:
  // Builds or reads it. Throws InputError for a mesh or texture that cannot be used, std::invalid_argument
  // for a configuration out of range. Same configuration, same surface, whatever the number of threads.
  explicit Terrain(const TerrainConfig& config);
  ~Terrain();
  Terrain(const Terrain&) = delete;
  Terrain& operator=(const Terrain&) = delete;

  // Distance [m] along `direction` (any length but zero; the distance is metric) to the first surface.
  [[nodiscard]] std::optional<double> castRay(const Eigen::Vector3d& origin,
                                              const Eigen::Vector3d& direction) const;
  // Depth [m] of the first surface seen from above; std::nullopt outside the terrain.
  [[nodiscard]] std::optional<double> depthAt(double north_m, double east_m) const;

  // Everything that rays hit (without what moves), for truth/terrain.ply; built anew at each call.
  [[nodiscard]] Mesh mesh() const;

  [[nodiscard]] const Eigen::Vector3d& lower() const;  // corners of the bounding box in nav [m]
  [[nodiscard]] const Eigen::Vector3d& upper() const;
  [[nodiscard]] const TerrainConfig& config() const;

  // For the renderer.
  [[nodiscard]] const SurfaceScene& surface() const { return *surface_; }

 private:
  std::unique_ptr<SurfaceScene> surface_;
  TerrainConfig config_;
};

}  // namespace fathom::sim
