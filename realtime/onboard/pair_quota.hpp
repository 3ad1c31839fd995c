#pragma once

#include "firmware_if/log/onboard_input.hpp"
#include "realtime/onboard/onboard_system.hpp"

namespace fathom::onboard {

// What a level of degradation leaves of a pair's work. Each level takes away what the one before it does, and
// more:
//   1  half of the stereo points;  2  no loop closures now;  3  a quarter of the points (so coarser cells)
//   and of the meshes fused anew;  4  the pair is dropped.
[[nodiscard]] inline OnboardSystem::PairQuota pairQuota(const io::Decision& decision) {
  OnboardSystem::PairQuota quota;
  quota.level = decision.level;
  quota.drop = decision.dropped;
  if (decision.level >= 1) quota.feature_share = 0.5;
  if (decision.level >= 2) quota.closures = false;
  if (decision.level >= 3) quota.feature_share = quota.rebuild_share = 0.25;
  return quota;
}

}  // namespace fathom::onboard
