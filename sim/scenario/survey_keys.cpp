#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

void visitCalibrationErrors(KeyVisitor& keys, CalibrationErrors& e) {
  keys.enter("calibration_errors", "by which mission.toml and stereo.calib are wrong; which way is drawn");
  keys.number("focal", e.focal, "1", 0, 0.2, "of each camera's focal lengths, relative");
  keys.number("centre", e.centre, "1", 0, 0.2, "of each principal point, of the image's width");
  keys.number("radial", e.radial, "1", 0, 1, "of each camera's k1");
  keys.angle("rig_deg", e.rig_angle, 0, 20, "between the cameras");
  keys.angle("rig_x_deg", e.rig_x, -20, 20, "between the cameras about the right one's x: not drawn");
  keys.angle("rig_y_deg", e.rig_y, -20, 20, "about its y, towards the left camera: not drawn");
  keys.angle("rig_z_deg", e.rig_z, -20, 20, "about its z: not drawn");
  keys.number("baseline", e.baseline, "1", -0.2, 0.2,
              "of the distance between the cameras, relative: not drawn");
  keys.number("rig_position_m", e.rig_position_m, "m", 0, 1, "of the right camera in the left one's frame");
  keys.angle("mounting_deg", e.mounting_angle, 0, 45, "of cameras, DVL and compass in body");
  keys.number("lever_arm_m", e.lever_arm_m, "m", 0, 5, "of each sensor in body");
  keys.number("time_s", e.time_s, "s", 0, 5,
              "of stamps of DVL, compass and depth, and of both cameras alike");
  keys.leave();
}

void visitSurvey(KeyVisitor& keys, SurveyPlan& p, VehicleConfig& v) {
  keys.enter("plan", "parallel lines over a rectangle, then cross lines");
  keys.number("north_m", p.north, "m", -5000, 5000, "centre of the rectangle in nav");
  keys.number("east_m", p.east, "m", -5000, 5000, "centre of the rectangle in nav");
  keys.angle("heading_deg", p.heading, -360, 360, "of the first line");
  keys.integer("lines", p.lines, 1, 500, "parallel lines");
  keys.number("line_length_m", p.line_length, "m", 1, 2000, "of a parallel line");
  keys.number("line_spacing_m", p.line_spacing, "m", 0.2, 100, "between parallel lines");
  keys.integer("cross_lines", p.cross_lines, 0, 100, "at right angles over the whole width");
  keys.number("overrun_m", p.overrun, "m", 0, 50, "of a cross line beyond the outermost lines");
  keys.number("climb_per_line_m", p.climb_per_line, "m", -5, 5,
              "of each line above the one before, up a wall");
  keys.leave();

  keys.enter("vehicle", "guidance and motion of the hull");
  keys.number("speed_mps", v.speed_mps, "m/s", 0.05, 2, "over ground on the lines");
  keys.number("acceleration_mps2", v.acceleration_mps2, "m/s2", 0.01, 2, "along track");
  keys.number("turn_radius_m", v.turn_radius_m, "m", 0.2, 50, "between lines");
  keys.angle("turn_rate_degps", v.turn_rate, 1, 90,
             "fastest turn a second; slows the vehicle in tight turns");
  keys.number("heading_lag_s", v.heading_lag_s, "s", 0.05, 10, "of the hull behind the track's direction");
  keys.number("altitude_m", v.follower.altitude_m, "m", 0.5, 50, "that the bottom follower keeps");
  keys.number("descent_rate_mps", v.follower.descent_rate_mps, "m/s", 0.01, 2, "fastest way down");
  keys.number("climb_rate_mps", v.follower.climb_rate_mps, "m/s", 0.01, 2, "fastest way up");
  keys.number("descent_lag_s", v.follower.descent_lag_s, "s", 0.05, 120,
              "of the follower when the seafloor falls away");
  keys.number("climb_lag_s", v.follower.climb_lag_s, "s", 0.05, 120,
              "of the follower when the seafloor rises");
  keys.number("depth_gain", v.follower.gain_per_s, "1/s", 0.01, 5, "depth error to vertical speed");
  keys.number("vertical_acceleration_mps2", v.follower.acceleration_mps2, "m/s2", 0.01, 2, "largest");
  keys.number("look_ahead_m", v.look_ahead_m, "m", 0, 50, "of the forward altimeter");
  keys.number("min_altitude_m", v.min_altitude_m, "m", 0.2, 40,
              "the vehicle stops to climb where less lies ahead; below altitude_m");
  keys.angle("roll_sigma_deg", v.roll_sigma, 0, 20, "oscillation, standard deviation");
  keys.angle("pitch_sigma_deg", v.pitch_sigma, 0, 20, "oscillation, standard deviation");
  keys.number("shortest_roll_period_s", v.shortest_roll_period_s, "s", 0.5, 60, "of roll and pitch");
  keys.number("longest_roll_period_s", v.longest_roll_period_s, "s", 0.5, 120, "of roll and pitch");
  keys.angle("heading_sigma_deg", v.heading_sigma, 0, 20, "wander about the track's direction");
  keys.angle("crab_deg", v.crab, -45, 45, "mean angle from track to hull, for a current from the side");
  keys.number("cross_track_sigma_m", v.cross_track_sigma_m, "m", 0, 5, "slow wander about the planned line");
  keys.number("float_s", v.float_s, "s", 1, 3600, "at the surface before and after, with GPS");
  keys.number("float_depth_m", v.float_depth_m, "m", 0, 2, "of body's origin when it floats");
  keys.number("dive_rate_mps", v.dive_rate_mps, "m/s", 0.05, 3, "down to the survey and up again");
  keys.number("climb_pitch", v.climb_pitch, "1", 0, 1, "of the climb's angle, that the hull pitches by");
  constexpr double kLast = 100000;  // [s]
  constexpr std::size_t kMost = 100;
  keys.listOf("hovers", v.hovers, kMost, "the vehicle stays where it is for a while", [&](Hover& hover) {
    keys.number("at_s", hover.at_s, "s", 0, kLast, "since the mission's start");
    keys.number("for_s", hover.for_s, "s", 0, 3600, "how long");
  });
  keys.listOf("collisions", v.collisions, kMost, "the hull is thrown aside and comes back",
              [&](Collision& c) {
                keys.number("at_s", c.at_s, "s", 0, kLast, "since the mission's start");
                keys.number("throw_m", c.throw_m, "m", -5, 5, "farthest, to starboard");
                keys.angle("turn_deg", c.turn, -180, 180, "of the heading");
                keys.number("recovers_s", c.recovers_s, "s", 0.2, 600, "time constant");
              });
  keys.leave();
}

}  // namespace fathom::sim
