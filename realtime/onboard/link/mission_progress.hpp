#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace fathom::onboard {

// Fraction of the planned path that the vehicle has covered. A waypoint is passed when the vehicle comes
// within the acceptance radius, or is nearer to the leg after it than to the leg before; beyond it the
// projection on the current leg counts. Never decreases.
class MissionProgress {
 public:
  // `plan`: waypoints (north, east) [m] in order; with fewer than two there is no progress.
  explicit MissionProgress(std::vector<Eigen::Vector2d> plan, double acceptance_radius = 3.0);

  void update(const Eigen::Vector2d& north_east);
  // 0 to 1; std::nullopt without a plan.
  [[nodiscard]] std::optional<double> fraction() const;

  // For saved state (state_archive.hpp), bit by bit, into one with the same plan.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t leg = self.leg_;
    archive(leg, self.travelled_);
    archive.require(leg == 0 || leg + 1 < self.plan_.size(), "a leg that is not in the plan");
    if constexpr (Archive::kLoading)
      if (archive.ok()) self.leg_ = leg;
  }

 private:
  std::vector<Eigen::Vector2d> plan_;
  std::vector<double> length_before_;  // of the path before each waypoint [m]
  double acceptance_radius_;           // [m]
  std::size_t leg_ = 0;                // from waypoint leg_ to leg_ + 1
  double travelled_ = 0;               // [m]
};

}  // namespace fathom::onboard
