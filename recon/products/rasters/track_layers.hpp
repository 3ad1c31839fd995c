#pragma once

#include <memory>
#include <string>
#include <vector>

#include "recon/products/rasters/sparse_cells.hpp"
#include "recon/products/tables/dive_track.hpp"

namespace fathom::topside {

struct TrackLayer {
  std::string name, title, unit;
  std::shared_ptr<const SparseCells> cells;
};

// What was measured along the track, as rasters: each cell within `radius` of the track [m] holds the mean of
// the points that near, weighted by 1 - (distance / radius)^2. Altitude, then water properties; only those
// that were recorded, and only where the vehicle surveyed (stage "survey" or none given).
[[nodiscard]] std::vector<TrackLayer> trackLayers(const std::vector<DiveTrackPoint>& track, double cell,
                                                  double radius);

}  // namespace fathom::topside
