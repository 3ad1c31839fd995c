#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "realtime/base/units.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/vehicle/survey_path.hpp"

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

// True pose of the vehicle over time, with continuous acceleration: a uniform cubic B-spline of north, east,
// depth and the Euler angles; its control points are the steps of the simulated guidance.
class Trajectory {
 public:
  // north, east, depth [m], roll, pitch, yaw [rad] (yaw not wrapped).
  using Knot = Eigen::Matrix<double, 6, 1>;

  struct State {
    SE3 T_nav_body;
    Eigen::Vector3d velocity_nav = Eigen::Vector3d::Zero();  // over ground [m/s]
    Eigen::Vector3d rates_body = Eigen::Vector3d::Zero();    // angular velocity in body [rad/s]
  };

  // Times in s since the mission's start. Throws std::invalid_argument for fewer than four knots.
  Trajectory(double knot_interval_s, std::vector<Knot> knots, double survey_begin_s, double survey_end_s,
             double dive_begin_s, double surfaced_s);

  [[nodiscard]] State at(double time_s) const;  // clamped to [0, duration()]
  [[nodiscard]] SE3 poseAt(double time_s) const;
  [[nodiscard]] double duration() const;  // [s]
  // The vehicle is at survey depth and on the plan's lines from surveyBegin() to surveyEnd(), at the surface
  // before diveBegin() and from surfaced() on.
  [[nodiscard]] double surveyBegin() const { return survey_begin_; }
  [[nodiscard]] double surveyEnd() const { return survey_end_; }
  [[nodiscard]] double diveBegin() const { return dive_begin_; }
  [[nodiscard]] double surfaced() const { return surfaced_; }

 private:
  // Value, first derivative of the spline.
  void evaluate(double time_s, Knot& value, Knot& derivative) const;

  double interval_;
  std::vector<Knot> knots_;
  double survey_begin_, survey_end_, dive_begin_, surfaced_;
};

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
