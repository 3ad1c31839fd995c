#pragma once

namespace fathom::sim {

struct BottomFollowerConfig {
  double altitude_m = 2.0;          // wanted, of the vehicle over the seafloor
  double descent_rate_mps = 0.12;   // fastest while it follows the seafloor down
  double climb_rate_mps = 0.30;     // fastest up
  double descent_lag_s = 4.0;       // time constant of the altimeter's filter when the seafloor falls away
  double climb_lag_s = 0.5;         // and when it rises
  double gain_per_s = 0.4;          // depth error to vertical speed
  double acceleration_mps2 = 0.10;  // vertical
};

// The vehicle's depth control: keeps an altitude over the altimeter's seafloor. It climbs at once and
// descends slowly, so that behind a ledge the altitude is larger for tens of seconds.
class BottomFollower {
 public:
  BottomFollower(const BottomFollowerConfig& config, double depth_m, double seafloor_depth_m);

  // One step of `dt_s`, with the shallowest seafloor under and ahead of the vehicle.
  void step(double dt_s, double seafloor_depth_m);
  // One step towards a given depth at no more than `rate_mps` (dives and ascents).
  void stepTowards(double dt_s, double depth_m, double rate_mps);

  [[nodiscard]] double depth() const { return depth_; }  // [m]
  [[nodiscard]] double wantedDepth() const { return seafloor_ - config_.altitude_m; }

 private:
  void move(double dt_s, double wanted_depth_m, double up_rate_mps, double down_rate_mps);

  BottomFollowerConfig config_;
  double depth_;
  double speed_ = 0;
  double seafloor_;  // as filtered
};

}  // namespace fathom::sim
