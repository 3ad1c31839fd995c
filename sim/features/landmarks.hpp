#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "sim/features/feature_config.hpp"
#include "sim/sea/terrain_config.hpp"

namespace fathom::sim {

// A place that looks like something: it lies on what is seen from above at its north and east.
struct Landmark {
  Eigen::Vector2d north_east;    // nav [m]
  double size = 0;               // diameter [m]
  double detection = 0;          // probability, in good light
  std::uint64_t appearance = 0;  // what it looks like
  std::uint64_t key = 0;         // which one it is: differs where appearances are copies
};

// The landmarks of a terrain, a function of the place: nothing is stored. Of any size d there are
//   n(larger than d) = density / d^2
// a square metre, so that a view shows as many at every altitude: size octaves, each with one landmark in
// every cell of a lattice. Three kinds of lattice: the ground's own; one along the ripples whose cells repeat
// (FeatureConfig::alike_share); and one fixed to each placed thing, so that twins carry copies.
class Landmarks {
 public:
  // `view_px`: width times height of an image, `smallest_px`: the size of its smallest feature.
  Landmarks(const TerrainConfig& terrain, const FeatureConfig& config, double view_px, double smallest_px);

  // Calls visit(landmark) for all landmarks of a size within [smallest, largest] [m] in cells that touch the
  // corners' box; some lie outside. `corners`: of an area, north and east [m].
  using Visitor = std::function<void(const Landmark&)>;
  void visit(const std::vector<Eigen::Vector2d>& corners, double smallest, double largest,
             const Visitor& visitor) const;

 private:
  struct Lattice {
    std::uint64_t seed = 0;
    Eigen::Vector2d origin = Eigen::Vector2d::Zero();  // nav [m]
    double heading = 0;                                // of its first axis [rad]
    Eigen::Vector2d period = Eigen::Vector2d::Zero();  // along its axes [m]; 0: none
    double radius = 0;                                 // about the origin [m]; 0: endless
    double share = 1;                                  // of its cells that hold a landmark
    std::size_t copy = 0;                              // tells copies of one seed apart
  };
  void visitLevel(const Lattice& lattice, int level, const std::vector<Eigen::Vector2d>& corners,
                  double smallest, double largest, const Visitor& visitor) const;
  [[nodiscard]] bool onThing(const Eigen::Vector2d& north_east) const;

  FeatureConfig config_;
  double cell_per_size_;  // edge of a cell by the smallest size of its octave
  std::vector<Lattice> grounds_, things_;
};

}  // namespace fathom::sim
