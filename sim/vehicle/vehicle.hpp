#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "realtime/base/units.hpp"
#include "sim/vehicle/bottom_follower.hpp"
#include "sim/vehicle/survey_path.hpp"
#include "sim/vehicle/trajectory.hpp"

namespace fathom::sim {

// The vehicle stays in place.
struct Hover {
  double at_s = 0, for_s = 60;  // since the mission's start; how long
};

// A collision displaces and turns the hull, which then returns.
struct Collision {
  double at_s = 0;                     // since the mission's start
  double throw_m = 0.2;                // farthest, to starboard
  double turn = degreesToRadians(15);  // of the heading [rad]
  double recovers_s = 4;               // time constant
};

struct VehicleConfig {
  double speed_mps = 0.5;           // over ground on the lines
  double acceleration_mps2 = 0.15;  // along track
  double turn_radius_m = 0.8;
  double turn_rate =
      degreesToRadians(23);     // fastest turn; slows the vehicle where the radius asks for more [rad/s]
  double heading_lag_s = 0.6;   // the hull follows the track's direction with this lag
  double look_ahead_m = 2.5;    // of the forward altimeter
  double min_altitude_m = 1.0;  // the vehicle stops to climb where less is ahead
  BottomFollowerConfig follower;
  double roll_sigma = degreesToRadians(1.5);                          // oscillation [rad]
  double pitch_sigma = degreesToRadians(1.2);                         // [rad]
  double shortest_roll_period_s = 4.0, longest_roll_period_s = 11.0;  // of roll and pitch
  double heading_sigma = degreesToRadians(1.7);  // wander about the track's direction [rad]
  double crab = degreesToRadians(3);             // mean angle between hull and track (side current) [rad]
  double cross_track_sigma_m = 0.08;             // slow wander about the planned line, north and east each
  double float_s = 20.0;                         // at the surface before and after
  double float_depth_m = 0.3;                    // of body's origin when it floats
  double dive_rate_mps = 0.35;                   // down to the survey and up again
  double climb_pitch = 0;                        // of the climb's angle, that the hull pitches by
  std::vector<Hover> hovers;
  std::vector<Collision> collisions;
};

// Depth of the seafloor under a point (north, east) of nav [m].
using SeafloorDepth = std::function<double(double, double)>;

// Simulates guidance and hull: floats, dives at the start of the plan, flies the plan at the follower's
// altitude, ascends, floats. The survey ends after `longest_survey_s` at the latest. Same arguments, same
// trajectory.
[[nodiscard]] Trajectory simulateVehicle(const SurveyPlan& plan, const VehicleConfig& config,
                                         const SeafloorDepth& seafloor, std::uint64_t seed,
                                         double longest_survey_s = std::numeric_limits<double>::infinity());

}  // namespace fathom::sim
