#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "sim/sea/light/surface_detail.hpp"
#include "sim/sea/sea_terrain.hpp"

namespace fathom::sim {

// Appearance of the true seafloor without water and strobes: its albedo with the renderer's fine texture, and
// its orientation to the viewer. Moving objects are left out. Thread-safe.
class Appearance {
 public:
  // `terrain` must outlive it.
  explicit Appearance(const SeaTerrain& terrain);

  struct Look {
    Eigen::Vector3d point;        // nav [m]
    std::array<float, 3> albedo;  // linear, red green blue
    float facing = 0;  // cosine between the textured surface's normal and the direction to the viewer
  };
  // The first hit of a ray, seen by a pixel that is `footprint_m` wide there; finer texture is left out.
  [[nodiscard]] std::optional<Look> look(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                         double footprint_m) const;

 private:
  const SeaTerrain& terrain_;
  SurfaceDetail detail_;
};

}  // namespace fathom::sim
