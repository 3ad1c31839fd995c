#pragma once

#include <Eigen/Core>
#include <optional>

#include "sim/sea/terrain.hpp"

namespace fathom::sim {

// The terrain, and beyond its edge (and in holes of a captured mesh) a flat seafloor that carries on at the
// depth of the nearest edge: acoustic beams and the vehicle reach further than the surveyed rectangle.
class WideSeafloor {
 public:
  explicit WideSeafloor(const Terrain& terrain) : terrain_(terrain) {}

  // Depth [m] under a point of nav.
  [[nodiscard]] double depthAt(double north_m, double east_m) const;
  // Distance [m] along a unit direction; std::nullopt for a ray that does not come down.
  [[nodiscard]] std::optional<double> castRay(const Eigen::Vector3d& origin,
                                              const Eigen::Vector3d& direction) const;

 private:
  const Terrain& terrain_;
};

}  // namespace fathom::sim
