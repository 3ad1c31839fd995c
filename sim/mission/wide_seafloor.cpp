#include "sim/mission/wide_seafloor.hpp"

#include <algorithm>

namespace fathom::sim {

double WideSeafloor::depthAt(double north_m, double east_m) const {
  if (const auto depth = terrain_.depthAt(north_m, east_m)) return *depth;
  constexpr double kInside = 0.05;  // keeps clear of the last row of triangles [m]
  const Eigen::Vector3d &low = terrain_.lower(), &high = terrain_.upper();
  const double north = std::clamp(north_m, low.x() + kInside, high.x() - kInside);
  const double east = std::clamp(east_m, low.y() + kInside, high.y() - kInside);
  return terrain_.depthAt(north, east).value_or(terrain_.config().base_depth_m);
}

std::optional<double> WideSeafloor::castRay(const Eigen::Vector3d& origin,
                                            const Eigen::Vector3d& direction) const {
  if (const auto distance = terrain_.castRay(origin, direction)) return distance;
  constexpr double kGrazing = 0.05;  // a flatter ray never meets a flat seafloor in any useful range
  if (direction.z() < kGrazing) return std::nullopt;
  // The edge's depth where the ray arrives, found by going to the mean depth first.
  double depth = terrain_.config().base_depth_m;
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d arrival = origin + (depth - origin.z()) / direction.z() * direction;
    depth = depthAt(arrival.x(), arrival.y());
  }
  const double distance = (depth - origin.z()) / direction.z();
  return distance > 0 ? std::optional<double>(distance) : std::nullopt;
}

}  // namespace fathom::sim
