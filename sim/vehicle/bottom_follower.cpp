#include "sim/vehicle/bottom_follower.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::sim {

BottomFollower::BottomFollower(const BottomFollowerConfig& config, double depth_m, double seafloor_depth_m)
    : config_(config), depth_(depth_m), seafloor_(seafloor_depth_m) {}

void BottomFollower::step(double dt_s, double seafloor_depth_m) {
  const bool rises = seafloor_depth_m < seafloor_;
  const double lag = rises ? config_.climb_lag_s : config_.descent_lag_s;
  seafloor_ += (seafloor_depth_m - seafloor_) * (1.0 - std::exp(-dt_s / lag));
  move(dt_s, wantedDepth(), config_.climb_rate_mps, config_.descent_rate_mps);
}

void BottomFollower::stepTowards(double dt_s, double depth_m, double rate_mps) {
  move(dt_s, depth_m, rate_mps, rate_mps);
}

void BottomFollower::move(double dt_s, double wanted_depth_m, double up_rate_mps, double down_rate_mps) {
  const double wanted =
      std::clamp(config_.gain_per_s * (wanted_depth_m - depth_), -up_rate_mps, down_rate_mps);
  const double step = config_.acceleration_mps2 * dt_s;
  speed_ += std::clamp(wanted - speed_, -step, step);
  depth_ += speed_ * dt_s;
}

}  // namespace fathom::sim
