#include "sim/scenario/scenario.hpp"

namespace fathom::sim {
namespace {

constexpr const char* kTerrainKinds[] = {"procedural", "mesh"};
constexpr const char* kFormats[] = {"mono", "bayer_rggb"};

void visitPath(KeyVisitor& keys, const char* key, std::filesystem::path& path, const char* meaning) {
  std::string text = path.string();
  keys.text(key, text, meaning);
  path = text;
}

void visitPlaced(KeyVisitor& keys, TerrainConfig& t) {
  constexpr std::size_t kMaxPlaced = 100;
  constexpr const char* kShapes[] = {"stone", "coral"};
  keys.listOf("placed", t.placed, kMaxPlaced, "objects at chosen places (procedural)",
              [&](PlacedConfig& thing) {
                keys.choiceOf("shape", thing.coral, kShapes, "");
                auto seed = static_cast<std::int64_t>(thing.seed);
                keys.integer("seed", seed, 0, 9007199254740992, "objects of one seed and size are equal");
                thing.seed = static_cast<std::uint64_t>(seed);
                keys.number("north_m", thing.north_m, "m", -5000, 5000, "in nav");
                keys.number("east_m", thing.east_m, "m", -5000, 5000, "in nav");
                keys.angle("heading_deg", thing.heading_rad, -360, 360, "clockwise from above");
                keys.number("size_m", thing.size_m, "m", 0.02, 10, "longest diameter");
              });
}

void visitGround(KeyVisitor& keys, TerrainConfig& t) {
  keys.enter("ripples", "sand waves (procedural)");
  keys.number("wavelength_m", t.ripples.wavelength_m, "m", 0.05, 10, "crest to crest");
  keys.number("height_m", t.ripples.height_m, "m", 0, 1, "trough to crest; 0: none");
  keys.angle("direction_deg", t.ripples.direction_rad, -360, 360, "of the current that formed them");
  keys.number("meander", t.ripples.meander, "1", 0, 1,
              "1: crests meander and fade out; 0: straight, the same everywhere");
  keys.leave();
  keys.enter("rubble", "loose stones in patches (procedural)");
  keys.number("density_per_m2", t.rubble.density_per_m2, "1/m2", 0, 100, "mean; 0: none");
  keys.number("min_size_m", t.rubble.min_size_m, "m", 0.005, 2, "longest diameter");
  keys.number("max_size_m", t.rubble.max_size_m, "m", 0.005, 2, "longest diameter");
  keys.number("patchiness", t.rubble.patchiness, "1", 0, 1, "0 even, 1 only in patches");
  keys.leave();
  keys.enter("boulders", "(procedural)");
  keys.number("density_per_m2", t.boulders.density_per_m2, "1/m2", 0, 10, "0: none");
  keys.number("min_size_m", t.boulders.min_size_m, "m", 0.02, 10, "longest diameter");
  keys.number("max_size_m", t.boulders.max_size_m, "m", 0.02, 10, "longest diameter");
  keys.leave();
  keys.enter("corals", "heads with overhanging caps (procedural)");
  keys.number("density_per_m2", t.corals.density_per_m2, "1/m2", 0, 10, "0: none");
  keys.number("min_size_m", t.corals.min_size_m, "m", 0.02, 10, "diameter of the cap");
  keys.number("max_size_m", t.corals.max_size_m, "m", 0.02, 10, "diameter of the cap");
  keys.number("overhang", t.corals.overhang, "1", 0, 0.8, "foot is thinner than the cap by this fraction");
  keys.leave();
  constexpr std::size_t kMaxLedges = 20;
  keys.listOf("ledges", t.ledges, kMaxLedges, "drop-offs (procedural)", [&](LedgeConfig& ledge) {
    keys.number("north_m", ledge.north_m, "m", -5000, 5000, "a point on its line");
    keys.number("east_m", ledge.east_m, "m", -5000, 5000, "a point on its line");
    keys.angle("heading_deg", ledge.heading_rad, -360, 360, "of descent");
    keys.number("drop_m", ledge.drop_m, "m", 0, 50, "height");
    keys.number("width_m", ledge.width_m, "m", 0.05, 50, "horizontal distance over which it falls");
    keys.number("undercut_m", ledge.undercut_m, "m", 0, 5, "by which the lip overhangs the wall");
  });
  visitPlaced(keys, t);
}

}  // namespace

void visitTerrain(KeyVisitor& keys, TerrainConfig& t) {
  keys.enter("terrain", "the seafloor");
  keys.choiceOf("kind", t.kind, kTerrainKinds, "procedural: grown from the seed; mesh: read from a file");
  auto seed = static_cast<std::int64_t>(t.seed);
  keys.integer("seed", seed, 0, 9007199254740992, "of the seafloor's shape and colour");
  t.seed = static_cast<std::uint64_t>(seed);
  keys.number("centre_north_m", t.centre_north_m, "m", -5000, 5000, "in nav");
  keys.number("centre_east_m", t.centre_east_m, "m", -5000, 5000, "in nav");
  keys.number("base_depth_m", t.base_depth_m, "m", 3, 5000,
              "mean depth before ledges; mesh: of its mean vertex");
  visitPath(keys, "mesh_file", t.mesh_file,
            "PLY in north, east, down; beside the scenario or under FATHOM_DATA_DIR");
  visitPath(keys, "relief_file", t.relief_file,
            "raster of heights (GeoTIFF, BAG) added to the bed; may be empty (procedural)");
  keys.number("relief_cell_m", t.relief_cell_m, "m", 0, 100,
              "side of its cells, to which it is scaled; 0: as the file states");
  visitPath(keys, "albedo_images", t.albedo_images,
            "folder of photographs of a seafloor that give its colours; may be empty");
  keys.number("albedo_pixel_m", t.albedo_pixel_m, "m", 1e-4, 0.05, "of ground a pixel of these");
  keys.number("albedo_contrast", t.albedo_contrast, "1", 0, 3, "of these over their own");
  visitPath(keys, "texture_file", t.texture_file, "image for the mesh's s, t; may be empty");
  keys.number("size_north_m", t.size_north_m, "m", 1, 500, "(procedural)");
  keys.number("size_east_m", t.size_east_m, "m", 1, 500, "(procedural)");
  keys.number("grid_spacing_m", t.grid_spacing_m, "m", 0.005, 1, "of the sand's vertices (procedural)");
  keys.number("undulation_m", t.undulation_m, "m", 0, 10,
              "standard deviation of the broad relief (procedural)");
  keys.number("undulation_wavelength_m", t.undulation_wavelength_m, "m", 0.5, 200, "(procedural)");
  keys.number("roughness_m", t.roughness_m, "m", 0, 0.2, "standard deviation below 0.5 m (procedural)");
  keys.number("detail_contrast", t.detail_contrast, "1", 0, 0.6,
              "of the fine texture, relative to the albedo");
  keys.integer("fish", t.fish, 0, 500, "swimming over the terrain; in pictures, not in the truth");
  keys.number("swaying_density_per_m2", t.swaying_density_per_m2, "1/m2", 0, 100,
              "blades of sea grass; in pictures, not in the truth");
  visitGround(keys, t);
  keys.leave();
}

void visitOptics(KeyVisitor& keys, OpticsConfig& o) {
  keys.enter("optics", "strobes, water and image sensors");
  keys.integer("edge_samples", o.edge_samples, 1, 8, "rays for a pixel on an edge: 1, 4 or 8");
  keys.number("flash_sigma", o.flash_sigma, "1", 0, 1,
              "of the strobes' energy from pair to pair, relative; truth/exposures.csv has each");
  keys.number("dark_probability", o.dark_probability, "1", 0, 1, "that the strobes stay dark in a pair");
  keys.number("misfire_probability", o.misfire_probability, "1", 0, 1,
              "that one strobe stays dark, each independently");
  keys.angle("vibration_deg", o.vibration_rad, 0, 2, "amplitude in roll and pitch, which no sensor measures");
  keys.number("vibration_hz", o.vibration_hz, "1/s", 1, 1000, "of pumps and thrusters");
  keys.enter("water", "absorption and scattering along the path of light; red, green, blue");
  keys.vector3("absorption_per_m", o.water.absorption_per_m, "1/m", 0, 10, "");
  keys.vector3("scattering_per_m", o.water.scattering_per_m, "1/m", 0, 10, "");
  keys.number("backscatter_fraction", o.water.backscatter_fraction, "1", 0, 1, "of the scattered light");
  keys.number("patches", o.water.patches, "1", 0, 10,
              "how far scattering follows the sediment's patches (sensors.water); 0: constant");
  keys.number("forward_per_m", o.water.forward_per_m, "1/m", 0, 5,
              "of the light that small-angle scattering spreads on its path to the camera");
  keys.angle("forward_deg", o.water.forward_rad, 0.01, 10, "standard deviation of that spread");
  keys.number("snow_per_m3", o.water.snow_per_m3, "1/m3", 0, 100000, "marine snow: particles above 0.5 mm");
  keys.number("snow_slope", o.water.snow_slope, "1", 1.5, 8, "their number falls with size as d^-slope");
  keys.number("snow_largest_mm", o.water.snow_largest_mm, "mm", 0.6, 50, "diameter");
  keys.number("snow_albedo", o.water.snow_albedo, "1", 0, 1, "");
  constexpr std::size_t kMostSilt = 100;
  keys.listOf("silt", o.water.silt, kMostSilt, "raised by the thrusters", [&](Silt& silt) {
    keys.number("at_s", silt.at_s, "s", 0, 100000, "since the mission's start");
    keys.number("times", silt.times, "1", 1, 100, "factor on the scattering");
    keys.number("settles_s", silt.settles_s, "s", 0.1, 3600, "time constant");
  });
  keys.leave();
  DaylightConfig& d = o.daylight;
  keys.enter("daylight", "sun and sky; 1 is the irradiance of a strobe of intensity 1 a metre away");
  keys.number("irradiance", d.irradiance, "1", 0, 1000, "just below the surface; 0: none");
  keys.angle("sun_elevation_deg", d.sun_elevation_rad, 1, 90, "in air");
  keys.angle("sun_azimuth_deg", d.sun_azimuth_rad, -360, 360, "clockwise from north");
  keys.number("sun_share", d.sun_share, "1", 0, 1, "of the irradiance; the rest is the sky's");
  keys.number("caustics", d.caustics, "1", 0, 2,
              "standard deviation of the sun's light on the seafloor, relative");
  keys.number("caustic_size_m", d.caustic_size_m, "m", 0.02, 10, "cells between bright lines");
  keys.number("caustic_period_s", d.caustic_period_s, "s", 0.05, 60, "in which they change");
  keys.leave();
  keys.enter("sensor", "the cameras' chips");
  keys.choiceOf("left_format", o.sensor.left_format, kFormats, "");
  keys.choiceOf("right_format", o.sensor.right_format, kFormats, "");
  keys.integer("bits", o.sensor.bits, 8, 12, "8 or 12");
  keys.vector3("quantum_efficiency", o.sensor.quantum_efficiency, "1", 0.001, 1, "red, green, blue");
  keys.number("full_well_electrons", o.sensor.full_well_electrons, "e", 100, 1e6, "at full scale");
  keys.number("read_noise_electrons", o.sensor.read_noise_electrons, "e", 0, 1e4, "standard deviation");
  keys.number("black_level", o.sensor.black_level, "1", 0, 0.5, "of full scale");
  keys.number("vignetting_power", o.sensor.vignetting_power, "1", 0, 10, "of the cosine off the axis");
  keys.number("blur_sigma_px", o.sensor.blur_sigma_px, "px", 0, 5, "lens and pixel aperture");
  keys.number("exposure", o.sensor.exposure, "1", 0.01, 100,
              "a white level seafloor at exposure_distance_m gives this fraction of full scale");
  keys.number("exposure_distance_m", o.sensor.exposure_distance_m, "m", 0.3, 50, "");
  keys.number("right_gain", o.sensor.right_gain, "1", 0.05, 20, "of the right camera over the left one's");
  keys.number("auto_exposure", o.sensor.auto_exposure, "1", 0, 1,
              "0: fixed; 1: the exposure follows the altitude so that the level stays, as the log states");
  keys.number("open_s", o.sensor.open_s, "s", 0, 0.2, "exposure time that causes motion blur; 0: none");
  keys.number("aperture_mm", o.sensor.aperture_mm, "mm", 0, 50, "of the lens; 0: everything is in focus");
  keys.number("focus_m", o.sensor.focus_m, "m", 0.1, 100, "");
  keys.number("glare", o.sensor.glare, "1", 0, 1,
              "fraction of a strobe's light at 1 m that lens and port scatter over the image");
  keys.leave();
  constexpr std::size_t kMaxStrobes = 8;
  keys.listOf("strobes", o.strobes, kMaxStrobes, "", [&](StrobeConfig& strobe) {
    keys.vector3("position_m", strobe.position_body, "m", -10, 10, "in body");
    keys.vector3("direction", strobe.direction_body, "1", -1, 1, "axis of the beam in body");
    keys.number("intensity", strobe.intensity, "1", 0, 100, "on the axis, relative to the other strobes");
    keys.angle("half_angle_deg", strobe.half_angle_rad, 5, 89, "at which the intensity is one half");
    keys.number("dies_at_s", strobe.dies_at_s, "s", 0, 1e6, "dark from then on, since the mission's start");
  });
  keys.leave();
}

void visitRig(KeyVisitor& keys, StereoRig& rig) {
  const auto camera = [&keys](const char* table, Camera& c, const char* meaning) {
    keys.enter(table, meaning);
    keys.integer("width", c.width, 64, 8192, "[px]");
    keys.integer("height", c.height, 64, 8192, "[px]");
    keys.number("fx", c.fx, "px", 20, 50000, "focal length");
    keys.number("fy", c.fy, "px", 20, 50000, "focal length");
    keys.number("cx", c.cx, "px", 0, 8192, "principal point");
    keys.number("cy", c.cy, "px", 0, 8192, "principal point");
    keys.number("k1", c.k1, "1", -2, 2, "radial distortion");
    keys.number("k2", c.k2, "1", -5, 5, "radial distortion");
    keys.number("p1", c.p1, "1", -0.1, 0.1, "tangential distortion");
    keys.number("p2", c.p2, "1", -0.1, 0.1, "tangential distortion");
    keys.number("k3", c.k3, "1", -5, 5, "radial distortion");
    keys.leave();
  };
  camera("left", rig.left, "left camera: the stereo frame");
  camera("right", rig.right, "right camera");
  visitPose(keys, "right_from_left", rig.T_right_left,
            "maps points of the left camera frame into the right's");
}

void visitPorts(KeyVisitor& keys, RigPorts& ports) {
  const auto port = [&keys](const char* table, FlatPort& p, const char* meaning) {
    keys.enter(table, meaning);
    keys.vector3("normal", p.normal, "1", -1, 1, "of the glass, towards the water, in the camera's frame");
    keys.number("distance_m", p.distance, "m", 0, 0.5, "from the camera's centre to the glass");
    keys.number("glass_m", p.glass, "m", 0, 0.1, "thickness");
    keys.number("glass_index", p.glass_index, "1", 1, 2, "index of refraction; 1.49 is acrylic");
    keys.number("water_index", p.water_index, "1", 1, 1.4, "index of refraction of the water");
    keys.leave();
  };
  port("left_port", ports.left, "port of the left camera, if calibrated = flat");
  port("right_port", ports.right, "port of the right camera, if calibrated = flat");
}

void visitCalibrationErrors(KeyVisitor& keys, CalibrationErrors& e) {
  keys.enter("calibration_errors",
             "errors of mission.toml and stereo.calib; their directions and signs are random");
  keys.number("focal", e.focal, "1", 0, 0.2, "of each camera's focal lengths, relative");
  keys.number("centre", e.centre, "1", 0, 0.2, "of each principal point, of the image's width");
  keys.number("radial", e.radial, "1", 0, 1, "of each camera's k1");
  keys.angle("rig_deg", e.rig_angle, 0, 20, "between the cameras");
  keys.angle("rig_x_deg", e.rig_x, -20, 20, "between the cameras about the right one's x: not random");
  keys.angle("rig_y_deg", e.rig_y, -20, 20, "about its y, towards the left camera: not random");
  keys.angle("rig_z_deg", e.rig_z, -20, 20, "about its z: not random");
  keys.number("baseline", e.baseline, "1", -0.2, 0.2,
              "of the distance between the cameras, relative: not random");
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
  keys.angle("turn_rate_degps", v.turn_rate, 1, 90, "fastest turn; slows the vehicle in tight turns");
  keys.number("heading_lag_s", v.heading_lag_s, "s", 0.05, 10, "of the hull behind the track's direction");
  keys.number("altitude_m", v.follower.altitude_m, "m", 0.5, 50, "that the bottom follower keeps");
  keys.number("descent_rate_mps", v.follower.descent_rate_mps, "m/s", 0.01, 2, "fastest descent");
  keys.number("climb_rate_mps", v.follower.climb_rate_mps, "m/s", 0.01, 2, "fastest ascent");
  keys.number("descent_lag_s", v.follower.descent_lag_s, "s", 0.05, 120,
              "of the follower when the seafloor falls away");
  keys.number("climb_lag_s", v.follower.climb_lag_s, "s", 0.05, 120,
              "of the follower when the seafloor rises");
  keys.number("depth_gain", v.follower.gain_per_s, "1/s", 0.01, 5, "depth error to vertical speed");
  keys.number("vertical_acceleration_mps2", v.follower.acceleration_mps2, "m/s2", 0.01, 2, "largest");
  keys.number("look_ahead_m", v.look_ahead_m, "m", 0, 50, "of the forward altimeter");
  keys.number("min_altitude_m", v.min_altitude_m, "m", 0.2, 40,
              "the vehicle stops to climb where the altitude ahead is less; below altitude_m");
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
  keys.listOf("hovers", v.hovers, kMost, "the vehicle stays in place", [&](Hover& hover) {
    keys.number("at_s", hover.at_s, "s", 0, kLast, "since the mission's start");
    keys.number("for_s", hover.for_s, "s", 0, 3600, "how long");
  });
  keys.listOf("collisions", v.collisions, kMost, "the hull is displaced and returns", [&](Collision& c) {
    keys.number("at_s", c.at_s, "s", 0, kLast, "since the mission's start");
    keys.number("throw_m", c.throw_m, "m", -5, 5, "farthest, to starboard");
    keys.angle("turn_deg", c.turn, -180, 180, "of the heading");
    keys.number("recovers_s", c.recovers_s, "s", 0.2, 600, "time constant");
  });
  keys.leave();
}

void visitFeatures(KeyVisitor& keys, SimulatedFeatureConfig& f) {
  keys.enter("features", "of missions without pictures (render --features)");
  keys.number("landmarks_per_view", f.landmarks_per_view, "1", 50, 5000, "on level ground, at any altitude");
  keys.number("smallest_size", f.smallest_size, "1", 0.002, 0.1,
              "of a feature, over the image's width; the largest is four times it");
  keys.number("least_detection", f.least_detection, "1", 0, 1,
              "the detection probability of a landmark is uniform between this");
  keys.number("most_detection", f.most_detection, "1", 0, 1, "and this");
  keys.number("half_contrast", f.half_contrast, "1", 0, 100,
              "ratio of contrast to pixel noise that halves the detections");
  visitPath(keys, "match_errors", f.match_errors,
            "CSV of match errors beside the scenario; empty: the shipped one, of rendered dives");
  keys.number("place_shared_variance", f.place_shared_variance, "1", 0, 1,
              "part of the place error's variance which neighbours in an image share");
  keys.number("descriptor_noise", f.descriptor_noise, "1", 0, 1.9,
              "median in a view, over the descriptor's standard deviation");
  keys.number("shared_place", f.shared_place, "1", 0, 0.01,
              "standard deviation of an error common to all features, drawn once for each dive; tangent");
  keys.number("shared_place_slope", f.shared_place_slope, "1", 0, 0.1,
              "likewise, radial; tangent by tangent");
  keys.number("shared_disparity_px", f.shared_disparity_px, "px", 0, 5, "likewise, of the disparity");
  keys.number("shared_disparity_slope_px", f.shared_disparity_slope_px, "px", 0, 5, "likewise, by tangent");
  keys.number("alike_share", f.alike_share, "1", 0, 1,
              "fraction of the landmarks that repeats at every ripple");
  keys.number("alike_along_m", f.alike_along_m, "m", 0.05, 10,
              "their period along the crests; across it is ripples.wavelength_m");
  keys.leave();
}

}  // namespace fathom::sim
