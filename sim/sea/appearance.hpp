#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "sim/sea/light/surface_detail.hpp"
#include "sim/sea/terrain.hpp"

namespace fathom::sim {

// What the true seafloor looks like without water and strobes: its albedo with the fine texture that
// photographs of it show, and how it is turned to whoever looks. Moving things are no part of it. Every
// method may be called from many threads at once.
class Appearance {
 public:
  // `terrain` must outlive it. The fine texture is the renderer's, to the grain.
  explicit Appearance(const Terrain& terrain);

  struct Look {
    Eigen::Vector3d point;        // nav [m]
    std::array<float, 3> albedo;  // linear, red green blue
    float facing = 0;             // cosine between the surface with its grains and the way back to the eye
  };
  // The first surface that a ray meets, seen by a pixel that is `footprint_m` wide there; finer texture
  // than that is left out.
  [[nodiscard]] std::optional<Look> look(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                         double footprint_m) const;

 private:
  const Terrain& terrain_;
  SurfaceDetail detail_;
};

}  // namespace fathom::sim
