#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "recon/geometry/se3.hpp"
#include "recon/topside/calibration/free_matches.hpp"

namespace fathom::topside {

// Stereo's seafloor as mean depths on a grid in plan, to be asked where the DVL's beams fell: beams and
// camera look at different places at any one moment, but the vehicle passes over both.
class RangeMap {
 public:
  void add(const SE3& T_nav_cam, const std::vector<SeenPoint>& points);

  // Mean depth [m] and mean range below the cameras that saw it [m] over places in plan (north, east), each
  // the mean of the 0.3 m about it, about a DVL beam's footprint; std::nullopt when fewer than `enough` of
  // them were seen.
  struct Seen {
    double depth = 0, range = 0;
  };
  [[nodiscard]] std::optional<Seen> at(const std::vector<Eigen::Vector2d>& places, int enough) const;

 private:
  static constexpr double kCell = 0.1;  // [m]
  struct Cell {
    double depth = 0, range = 0;
    int points = 0;
  };
  [[nodiscard]] static std::pair<std::int64_t, std::int64_t> cellOf(double north, double east);
  std::map<std::pair<std::int64_t, std::int64_t>, Cell> cells_;
};

}  // namespace fathom::topside
