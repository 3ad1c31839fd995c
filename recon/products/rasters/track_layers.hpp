#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/products/rasters/cog_writer.hpp"
#include "recon/products/tables/dive_tables.hpp"

namespace fathom::topside {

// Values in cells of a lattice, in memory, in squares of 64 x 64 cells.
class SparseCells {
 public:
  explicit SparseCells(double cell) : cell_(cell) {}
  void set(std::int32_t x, std::int32_t y, float value);
  [[nodiscard]] float get(std::int32_t x, std::int32_t y) const;  // NaN where nothing was set
  [[nodiscard]] double cell() const { return cell_; }
  [[nodiscard]] CellWindow extent() const;
  [[nodiscard]] bool touches(const CellWindow& window) const;
  void read(const CellWindow& window, float* out) const;

 private:
  using Key = std::pair<std::int32_t, std::int32_t>;
  double cell_;
  std::map<Key, std::vector<float>> squares_;
  CellWindow extent_;
};

[[nodiscard]] RasterSource sourceOf(const std::shared_ptr<const SparseCells>& cells);

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
