#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "realtime/kernel/fixed_queue.hpp"

namespace fathom::lighting {

// Which images show ground that was not learnt from just before: a vehicle that hovers would print its scene
// into what is held for the light's pattern. An image is taken when its camera is farther than a fifth of its
// footprint from those of the last 64 that were. Fixed memory.
class NewGround {
 public:
  // `camera`: its place in a frame that does not leap [m]; `footprint`: the shorter side of what it sees [m].
  [[nodiscard]] bool take(const Eigen::Vector3d& camera, double footprint) noexcept {
    for (std::size_t i = 0; i < taken_.size(); ++i)
      if ((taken_[i] - camera).norm() < kNewShare * footprint) return false;
    taken_.pushDroppingOldest(camera);
    return true;
  }

  // For saved state (state_archive.hpp), bit by bit.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.taken_);
  }

 private:
  static constexpr double kNewShare = 0.2;
  static constexpr std::size_t kPlaces = 64;
  rt::FixedQueue<Eigen::Vector3d, kPlaces> taken_;
};

}  // namespace fathom::lighting
