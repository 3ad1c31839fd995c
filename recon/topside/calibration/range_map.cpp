#include "recon/topside/calibration/range_map.hpp"

#include <cmath>

namespace fathom::topside {

std::pair<std::int64_t, std::int64_t> RangeMap::cellOf(double north, double east) {
  return {static_cast<std::int64_t>(std::floor(north / kCell)),
          static_cast<std::int64_t>(std::floor(east / kCell))};
}

void RangeMap::add(const SE3& T_nav_cam, const std::vector<SeenPoint>& points) {
  for (const SeenPoint& p : points) {
    const Eigen::Vector3d in_nav = T_nav_cam * p.point;
    Cell& cell = cells_[cellOf(in_nav.x(), in_nav.y())];
    cell.depth += in_nav.z();
    cell.range += in_nav.z() - T_nav_cam.translation().z();
    ++cell.points;
  }
}

std::optional<RangeMap::Seen> RangeMap::at(const std::vector<Eigen::Vector2d>& places, int enough) const {
  Seen sum;
  int found = 0;
  for (const Eigen::Vector2d& place : places) {
    const auto [north, east] = cellOf(place.x(), place.y());
    Seen here;
    int cells = 0;
    for (std::int64_t n = north - 1; n <= north + 1; ++n)
      for (std::int64_t e = east - 1; e <= east + 1; ++e) {
        const auto cell = cells_.find({n, e});
        if (cell == cells_.end()) continue;
        here.depth += cell->second.depth / cell->second.points;
        here.range += cell->second.range / cell->second.points;
        ++cells;
      }
    constexpr int kEnoughCells = 3;  // of nine
    if (cells < kEnoughCells) continue;
    sum.depth += here.depth / cells;
    sum.range += here.range / cells;
    ++found;
  }
  if (found < enough) return std::nullopt;
  return Seen{sum.depth / found, sum.range / found};
}

}  // namespace fathom::topside
