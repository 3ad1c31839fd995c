#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace fathom::onboard {

// How much of the planned path lies behind the vehicle. A waypoint counts as passed when the vehicle comes
// within the acceptance radius, or when it is nearer to the leg after it than to the leg before; the rest of
// the way is the projection on the current leg. Never runs backwards.
class MissionProgress {
 public:
  // `plan`: waypoints (north, east) [m] in order; fewer than two: no progress can be told.
  explicit MissionProgress(std::vector<Eigen::Vector2d> plan, double acceptance_radius = 3.0);

  void update(const Eigen::Vector2d& north_east);
  // 0 to 1; std::nullopt without a plan.
  [[nodiscard]] std::optional<double> fraction() const;

 private:
  std::vector<Eigen::Vector2d> plan_;
  std::vector<double> length_before_;  // of the path before each waypoint [m]
  double acceptance_radius_;           // [m]
  std::size_t leg_ = 0;                // from waypoint leg_ to leg_ + 1
  double travelled_ = 0;               // [m]
};

}  // namespace fathom::onboard
