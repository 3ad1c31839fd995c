#pragma once

#include <Eigen/Core>
#include <array>

namespace fathom::sim {

// The shortest curve of bounded curvature between two poses in the plane (Dubins 1957; the closed forms of
// Shkel and Lumelsky 2001): three pieces, each an arc of `radius` to port or starboard or a straight line.
struct DubinsCurve {
  std::array<double, 3> curvature{};  // [1/m], positive to starboard (clockwise in north-east)
  std::array<double, 3> length{};     // [m]
  [[nodiscard]] double total() const { return length[0] + length[1] + length[2]; }
};
[[nodiscard]] DubinsCurve shortestDubins(const Eigen::Vector2d& from, double from_heading,
                                         const Eigen::Vector2d& to, double to_heading, double radius);

}  // namespace fathom::sim
