#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "sim/sea/ground/surface_scene.hpp"
#include "sim/sea/terrain_config.hpp"

namespace fathom::sim {

// Closed surfaces about their own origin, z down, normals outwards. Same seed, same shape. `edge_m`:
// approximate length of the triangles' edges.

// An angular stone, broken rather than round; `size_m` is its longest diameter.
[[nodiscard]] TriangleSurface makeStone(std::uint64_t seed, double size_m, double edge_m);
// A coral head: a knobbly cap of diameter `size_m` on a foot that is thinner by the fraction `overhang`; the
// origin is where the foot enters the seafloor.
[[nodiscard]] TriangleSurface makeCoralHead(std::uint64_t seed, double size_m, double overhang,
                                            double edge_m);

// Rotates, then translates a surface.
void place(TriangleSurface& surface, const Eigen::Matrix3f& rotation, const Eigen::Vector3f& translation);

// Area-weighted normals of the vertices from the triangles.
void computeSurfaceNormals(TriangleSurface& surface);

// Fish on circuits and blades that sway with the swell, as a function of time and of the terrain's seed. They
// are in pictures only.
class MovingObjects {
 public:
  // `bed`: committed.
  MovingObjects(const TerrainConfig& config, const SurfaceScene& bed);
  // A committed scene, in the bed's frame, of everything within `radius_m` (horizontally) of `centre`, which
  // is in that frame; nullptr when there is nothing.
  [[nodiscard]] std::unique_ptr<SurfaceScene> near(const Eigen::Vector3f& centre, float radius_m,
                                                   double time_s) const;

 private:
  struct Fish {
    double length_m, speed_mps, circuit_m, phase, height_m;
    Eigen::Vector2d centre;  // of its circuit, local frame [m]
  };
  struct Blade {
    Eigen::Vector3f root;
    float length_m, width_m, tilt_rad, turn_rad, tone;
  };
  [[nodiscard]] TriangleSurface fishAt(const Fish& fish, const Eigen::Vector2d& place, double time_s) const;
  [[nodiscard]] static TriangleSurface bladeAt(const Blade& blade, double time_s);
  [[nodiscard]] static Eigen::Vector2d placeOf(const Fish& fish, double time_s);

  const SurfaceScene& bed_;
  std::vector<Fish> fish_;
  std::vector<Blade> blades_;
};

}  // namespace fathom::sim
