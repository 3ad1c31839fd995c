#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "recon/geometry/stereo_feature_frame.hpp"
#include "sim/features/feature_config.hpp"
#include "sim/sea/terrain_config.hpp"

namespace fathom::sim {

// A place with a recognisable appearance, on the first surface seen from above at its north and east.
struct Landmark {
  Eigen::Vector2d north_east;    // nav [m]
  double size = 0;               // diameter [m]
  double detection = 0;          // probability, in good light
  std::uint64_t appearance = 0;  // seed of its descriptor
  std::uint64_t key = 0;         // identity; differs between landmarks of equal appearance
};

// The landmarks of a terrain, a function of the place: nothing is stored. Of any size d there are
//   n(larger than d) = density / d^2
// for each square metre, so that a view shows the same number at every altitude: size octaves, each with one
// landmark in every cell of a lattice. Lattices are the ground's; one along the ripples with repeating cells
// (SimulatedFeatureConfig::alike_share); and one fixed to each placed object, so that equal objects have
// equal landmarks.
class Landmarks {
 public:
  // `view_px`: width times height of an image, `smallest_px`: the size of its smallest feature.
  Landmarks(const TerrainConfig& terrain, const SimulatedFeatureConfig& config, double view_px,
            double smallest_px);

  // Calls visitor(landmark) for all landmarks of a size within [smallest, largest] [m] in the lattice cells
  // that touch the bounding box of `corners` (north and east [m]); some are outside the box.
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
    std::size_t copy = 0;                              // distinguishes lattices of one seed
  };
  void visitLevel(const Lattice& lattice, int level, const std::vector<Eigen::Vector2d>& corners,
                  double smallest, double largest, const Visitor& visitor) const;
  [[nodiscard]] bool onPlacedObject(const Eigen::Vector2d& north_east) const;

  SimulatedFeatureConfig config_;
  double cell_per_size_;  // edge of a cell by the smallest size of its octave
  std::vector<Lattice> ground_lattices_, object_lattices_;
};

// Simulated root-SIFT descriptor (norm 512) of a landmark's surroundings in one view:
//   d = 512 |g| / ||g||,   g = M z + own + noise n,
// where z (kLatent normal deviates) and own (one for each of the 128 bins) depend on the appearance, n on the
// view and the feature, and M is constant. The low dimension of z makes different surroundings somewhat
// similar, as for real descriptors; distances are those of root-SIFT on rendered seafloors (tests/bench).
// Same arguments, same bytes.
[[nodiscard]] RootSift simulatedDescriptor(std::uint64_t appearance, std::uint64_t view_seed,
                                           std::uint64_t feature, float noise);

}  // namespace fathom::sim
