#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "realtime/kernel/rings/fixed_queue.hpp"

namespace fathom::lighting {

// Selects images of new ground to learn from: a vehicle that hovers would imprint its scene on the light's
// pattern. An image is taken when its camera is farther than a fifth of its footprint from the last 64 that
// were taken. Fixed memory.
class NewGround {
 public:
  // `camera`: position in a frame without jumps [m]; `footprint`: its shorter side [m].
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
