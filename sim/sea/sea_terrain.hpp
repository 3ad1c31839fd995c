#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>

#include "recon/geometry/mesh.hpp"
#include "sim/sea/terrain_config.hpp"

namespace fathom::sim {

class SurfaceDetail;
class SurfaceScene;

// The true seafloor: coloured triangles in nav (north, east, down, [m]) with ray queries (Embree). Immutable
// and thread-safe.
class SeaTerrain {
 public:
  // Builds or reads it. Throws InputError for a mesh or texture that cannot be used, std::invalid_argument
  // for a configuration out of range. Same configuration, same surface, whatever the number of threads.
  explicit SeaTerrain(const TerrainConfig& config);
  ~SeaTerrain();
  SeaTerrain(const SeaTerrain&) = delete;
  SeaTerrain& operator=(const SeaTerrain&) = delete;

  // Distance [m] along `direction` (any length but zero; the distance is metric) to the first surface.
  [[nodiscard]] std::optional<double> castRay(const Eigen::Vector3d& origin,
                                              const Eigen::Vector3d& direction) const;
  // Depth [m] of the first surface seen from above; std::nullopt outside the terrain.
  [[nodiscard]] std::optional<double> depthAt(double north_m, double east_m) const;

  // All surfaces without moving objects, for truth/terrain.ply; built at each call.
  [[nodiscard]] Mesh mesh() const;

  [[nodiscard]] const Eigen::Vector3d& lower() const;  // corners of the bounding box in nav [m]
  [[nodiscard]] const Eigen::Vector3d& upper() const;
  [[nodiscard]] const TerrainConfig& config() const;

  // For the renderer.
  [[nodiscard]] const SurfaceScene& surface() const { return *surface_; }
  [[nodiscard]] const SurfaceDetail& detail() const { return *detail_; }

 private:
  std::unique_ptr<SurfaceScene> surface_;
  std::unique_ptr<const SurfaceDetail> detail_;
  TerrainConfig config_;
};

// The terrain, continued beyond its edge (and in holes of a captured mesh) by a flat seafloor at the depth of
// the nearest edge, since acoustic beams and the vehicle reach beyond the surveyed rectangle.
class WideSeafloor {
 public:
  explicit WideSeafloor(const SeaTerrain& terrain) : terrain_(terrain) {}

  // Depth [m] under a point of nav.
  [[nodiscard]] double depthAt(double north_m, double east_m) const;
  // Distance [m] along a unit direction; std::nullopt for a ray that does not come down.
  [[nodiscard]] std::optional<double> castRay(const Eigen::Vector3d& origin,
                                              const Eigen::Vector3d& direction) const;

 private:
  const SeaTerrain& terrain_;
};

}  // namespace fathom::sim
