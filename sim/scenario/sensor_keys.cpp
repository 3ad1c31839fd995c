#include "realtime/base/units.hpp"
#include "sim/scenario/scenario.hpp"

namespace fathom::sim {
namespace {

constexpr double kMaxRate = 100;          // [1/s]
constexpr double kMaxLatency = 10;        // [s]
constexpr double kLastFault = 100000;     // [s]
constexpr std::size_t kMaxFaults = 1000;  // of one kind

void visitTimeSpan(KeyVisitor& keys, TimeSpan& spell) {
  keys.number("from_s", spell.from_s, "s", 0, kLastFault, "since the mission's start");
  keys.number("to_s", spell.to_s, "s", 0, kLastFault, "since the mission's start");
}

void visitTimeSpans(KeyVisitor& keys, const char* key, std::vector<TimeSpan>& spells, const char* meaning) {
  keys.listOf(key, spells, kMaxFaults, meaning, [&](TimeSpan& spell) { visitTimeSpan(keys, spell); });
}

void visitDvl(KeyVisitor& keys, SimulatedDvlConfig& c) {
  keys.enter("dvl", "Doppler velocity log with four Janus beams");
  keys.number("rate_hz", c.rate_hz, "1/s", 0.1, kMaxRate, "ensembles");
  keys.number("velocity_sigma_mps", c.velocity_sigma_mps, "m/s", 0, 1, "white noise of each axis");
  keys.number("scale_error", c.scale_error, "1", 0, 0.1, "largest; drawn once a dive");
  keys.number("range_sigma_m", c.range_sigma_m, "m", 0, 5, "white noise of each beam's range");
  keys.number("dropout_probability", c.dropout_probability, "1", 0, 1, "that an ensemble begins a dropout");
  keys.number("dropout_length", c.dropout_length, "ensembles", 1, 1000, "mean length of a dropout");
  keys.angle("beam_angle_deg", c.beam_angle, 5, 60, "of the beams off the axis");
  keys.number("min_range_m", c.min_range_m, "m", 0, 10, "of bottom lock");
  keys.number("max_range_m", c.max_range_m, "m", 1, 1000, "of bottom lock");
  keys.number("assumed_sound_speed_mps", c.assumed_sound_speed_mps, "m/s", 1350, 1650,
              "that the instrument computes with; the water has its own");
  keys.number("latency_s", c.latency_s, "s", 0, kMaxLatency, "from measurement to arrival");
  keys.number("velocity_sigma_per_m", c.velocity_sigma_per_m, "1/s", 0, 0.1, "more noise, by the altitude");
  keys.integer("dead_beam", c.dead_beam, 0, 4, "a beam without echo; 0: none");
  keys.number("fish_probability", c.fish_probability, "1", 0, 1,
              "that a beam of an ensemble is reflected in the water");
  keys.angle("steepest_deg", c.steepest, 30, 90, "incidence on the seafloor beyond which a beam is lost");
  keys.number("bubble_depth_m", c.bubble_depth_m, "m", 0, 50, "above it there is no bottom lock");
  keys.number("current_north_mps", c.current_north_mps, "m/s", -3, 3, "of the water, for false_bottom");
  keys.number("current_east_mps", c.current_east_mps, "m/s", -3, 3, "of the water, for false_bottom");
  visitTimeSpans(keys, "outages", c.outages, "no ensembles");
  visitTimeSpans(keys, "stuck", c.stuck, "the last good ensemble is repeated");
  visitTimeSpans(keys, "false_bottom", c.false_bottom,
                 "locked to a layer at half the range, which drifts with the water");
  keys.leave();
}

void visitCompass(KeyVisitor& keys, CompassConfig& c) {
  keys.enter("compass", "magnetic heading, roll and pitch");
  keys.number("rate_hz", c.rate_hz, "1/s", 0.1, kMaxRate, "samples");
  keys.angle("deviation_deg", c.deviation, 0, 30, "amplitude of the deviation over the heading");
  keys.angle("drift_sigma_deg", c.drift_sigma, 0, 30, "slow change of the deviation");
  keys.angle("heading_sigma_deg", c.heading_sigma, 0, 30, "white noise of heading");
  keys.angle("tilt_bias_sigma_deg", c.tilt_bias_sigma, 0, 10, "of roll and pitch, drawn once a dive");
  keys.angle("tilt_sigma_deg", c.tilt_sigma, 0, 10, "white noise of roll and pitch");
  keys.number("latency_s", c.latency_s, "s", 0, kMaxLatency, "from measurement to arrival");
  keys.angle("soft_iron_deg", c.soft_iron, 0, 30, "amplitude of the deviation twice over the heading");
  keys.number("lag_s", c.lag_s, "s", 0, 10, "of heading, roll and pitch behind the hull");
  keys.number("acceleration_share", c.acceleration_share, "1", 0, 1,
              "of the hull's acceleration that is taken for gravity");
  keys.listOf("jumps", c.jumps, kMaxFaults, "sudden errors of the heading, which stay",
              [&](CompassJump& jump) {
                keys.number("at_s", jump.at_s, "s", 0, kLastFault, "since the mission's start");
                keys.angle("deg", jump.turn, -360, 360, "added to the heading from then on");
              });
  keys.listOf(
      "anomalies", c.anomalies, kMaxFaults, "magnetic objects on the seafloor",
      [&](MagneticAnomaly& anomaly) {
        keys.number("north_m", anomaly.north_m, "m", -5000, 5000, "in nav");
        keys.number("east_m", anomaly.east_m, "m", -5000, 5000, "in nav");
        keys.number("depth_m", anomaly.depth_m, "m", 0, 5000,
                    "in nav; 0: a radius below the compass, however deep that is");
        keys.number("radius_m", anomaly.radius_m, "m", 0.1, 1000, "how far above it the error is as stated");
        keys.angle("deg", anomaly.turn, -180, 180, "added to the heading there; a dipole's fall elsewhere");
      });
  keys.leave();
}

// A value in rad whose unit contains degrees in the file.
void inDegrees(KeyVisitor& keys, const char* key, double& value, const char* unit, double most,
               const char* meaning) {
  double in_degrees = value / degreesToRadians(1);
  keys.number(key, in_degrees, unit, 0, most, meaning);
  value = degreesToRadians(in_degrees);
}

void visitGyro(KeyVisitor& keys, GyroConfig& c) {
  keys.enter("gyro", "rates of turn about the compass's axes");
  keys.number("rate_hz", c.rate_hz, "1/s", 0, kMaxRate, "samples; 0: there is no gyro");
  inDegrees(keys, "angle_random_walk_deg", c.angle_random_walk, "deg/s^(1/2)", 1, "white noise of the rates");
  inDegrees(keys, "bias_sigma_deg_s", c.bias_sigma, "deg/s", 10, "of each axis, drawn once a dive");
  inDegrees(keys, "bias_walk_deg_s", c.bias_walk, "deg/s^(3/2)", 1, "random walk of the bias");
  keys.number("latency_s", c.latency_s, "s", 0, kMaxLatency, "from measurement to arrival");
  keys.leave();
}

void visitErrorBursts(KeyVisitor& keys, const char* key, std::vector<UsblErrorBurst>& echoes,
                      const char* meaning, const char* place) {
  keys.listOf(key, echoes, kMaxFaults, meaning, [&](UsblErrorBurst& echo) {
    visitTimeSpan(keys, echo);
    keys.number("north_m", echo.north_m, "m", -5000, 5000, place);
    keys.number("east_m", echo.east_m, "m", -5000, 5000, place);
  });
}

void visitPositioning(KeyVisitor& keys, UsblConfig& u, GpsConfig& g) {
  keys.enter("usbl", "the ship's acoustic positioning, sent to the vehicle over the modem");
  keys.number("period_s", u.period_s, "s", 0.5, 600, "between pings");
  keys.number("range_sigma_m", u.range_sigma_m, "m", 0, 50, "noise of the range");
  keys.angle("angle_sigma_deg", u.angle_sigma, 0, 20, "noise of bearing and elevation");
  keys.number("ship_north_m", u.ship_north_m, "m", -5000, 5000, "transceiver in nav");
  keys.number("ship_east_m", u.ship_east_m, "m", -5000, 5000, "transceiver in nav");
  keys.number("ship_depth_m", u.ship_depth_m, "m", 0, 50, "transceiver in nav");
  keys.number("delay_s", u.delay_s, "s", 0, 60, "mean, from ping to arrival on board");
  keys.number("outlier_probability", u.outlier_probability, "1", 0, 1, "of a fix");
  keys.number("outlier_m", u.outlier_m, "m", 0, 1000, "mean size of an outlier");
  keys.angle("misalignment_deg", u.misalignment, -30, 30, "of the transceiver, unknown to the ship");
  keys.number("offset_north_m", u.offset_north_m, "m", -100, 100, "of the ship's position, unknown to it");
  keys.number("offset_east_m", u.offset_east_m, "m", -100, 100, "of the ship's position, unknown to it");
  keys.number("range_sigma_per_m", u.range_sigma_per_m, "1", 0, 0.2, "more noise of the range, by the range");
  keys.angle("bending_deg", u.bending, 0, 20, "of the ray, downwards");
  keys.angle("heading_wobble_deg", u.heading_wobble, 0, 20,
             "of the ship's compass over minutes, standard deviation");
  keys.number("ship_circle_m", u.ship_circle_m, "m", 0, 1000,
              "radius of the ship's circle about its place; 0: it is at rest");
  keys.number("ship_lap_s", u.ship_lap_s, "s", 60, 86400, "once round");
  visitErrorBursts(keys, "multipath", u.multipath, "bursts of correlated errors", "added to the fix");
  visitErrorBursts(keys, "wrong_targets", u.wrong_targets, "fixes of another transponder",
                   "where it is, in nav");
  keys.leave();
  keys.enter("gps", "at the surface before and after the dive");
  keys.number("rate_hz", g.rate_hz, "1/s", 0.01, kMaxRate, "fixes");
  keys.number("drift_sigma_m", g.drift_sigma_m, "m", 0, 100, "slow error, north and east each");
  keys.number("sigma_m", g.sigma_m, "m", 0, 100, "white error, north and east each");
  keys.number("latency_s", g.latency_s, "s", 0, kMaxLatency, "from measurement to arrival");
  keys.leave();
}

void visitWater(KeyVisitor& keys, WaterSensorConfig& c) {
  keys.enter("water", "conductivity, temperature and optical sensors, and the water itself");
  keys.number("rate_hz", c.rate_hz, "1/s", 0, kMaxRate, "samples; 0: there are none");
  keys.number("temperature_c", c.temperature_c, "deg C", 2, 30, "of the water");
  keys.number("salinity_psu", c.salinity_psu, "psu", 25, 40, "of the water");
  keys.number("temperature_sigma_c", c.temperature_sigma_c, "deg C", 0, 5, "white noise");
  keys.number("conductivity_sigma", c.conductivity_sigma, "S/m", 0, 1, "white noise");
  keys.number("chlorophyll_ug_l", c.chlorophyll_ug_l, "ug/l", 0, 100, "mean");
  keys.number("cdom_ppb", c.cdom_ppb, "ppb", 0, 500, "mean, coloured dissolved organic matter");
  keys.number("turbidity", c.turbidity, "1/m/sr", 0, 1, "mean optical backscatter");
  keys.number("optics_relative_sigma", c.optics_relative_sigma, "1", 0, 1, "white noise of the last three");
  keys.number("latency_s", c.latency_s, "s", 0, kMaxLatency, "from measurement to arrival");
  keys.leave();
}

void visitBattery(KeyVisitor& keys, BatteryConfig& c) {
  keys.enter("battery", "of the vehicle, as its management system reports it");
  keys.number("rate_hz", c.rate_hz, "1/s", 0.01, kMaxRate, "samples");
  keys.number("capacity_wh", c.capacity_wh, "Wh", 1, 1e6, "when full");
  keys.number("start_charge", c.start_charge, "1", 0, 1, "share left at the mission's start");
  keys.number("hotel_w", c.hotel_w, "W", 0, 1e5, "drawn always");
  keys.number("thrust_w_per_m3ps3", c.thrust_w_per_m3ps3, "W/(m/s)^3", 0, 1e5,
              "drawn by the thrusters, by the speed's cube");
  keys.number("full_v", c.full_v, "V", 1, 1000, "open voltage when full");
  keys.number("empty_v", c.empty_v, "V", 1, 1000, "open voltage when empty");
  keys.number("resistance_ohm", c.resistance_ohm, "ohm", 0, 10, "inside");
  keys.number("latency_s", c.latency_s, "s", 0, kMaxLatency, "from measurement to arrival");
  keys.leave();
}

void visitCameraClocks(KeyVisitor& keys, CameraClockConfig& c) {
  keys.enter("cameras", "trigger and clocks; both cameras expose at the same instant");
  keys.number("rate_hz", c.rate_hz, "1/s", 0.1, 30, "pairs");
  keys.number("exposure_s", c.exposure_s, "s", 1e-5, 0.1, "of the strobes' flash, as stated in the log");
  keys.number("left_offset_s", c.left_offset_s, "s", -10, 10, "left clock minus UTC at the start");
  keys.number("right_offset_s", c.right_offset_s, "s", -10, 10, "right clock minus UTC at the start");
  keys.number("left_drift", c.left_drift, "s/s", -1e-3, 1e-3, "of the left clock (50 ppm: 5e-5)");
  keys.number("right_drift", c.right_drift, "s/s", -1e-3, 1e-3, "of the right clock");
  keys.number("known_to_s", c.known_to_s, "s", 0, 1, "largest error of the offsets in mission.toml");
  keys.number("latency_s", c.latency_s, "s", 0, kMaxLatency, "from exposure to arrival");
  keys.number("right_delay_s", c.right_delay_s, "s", 0, 0.1, "of the right shutter, not stated anywhere");
  keys.leave();
}

}  // namespace

void visitSensors(KeyVisitor& keys, SensorsConfig& s) {
  keys.enter("sensors", "rates and errors; the defaults are those of the AUV Sirius");
  visitDvl(keys, s.dvl);
  visitCompass(keys, s.compass);
  visitGyro(keys, s.gyro);
  keys.enter("depth", "pressure sensor");
  keys.number("rate_hz", s.depth.rate_hz, "1/s", 0.1, kMaxRate, "samples");
  keys.number("scale_error", s.depth.scale_error, "1", 0, 0.1, "standard deviation; drawn once a dive");
  keys.number("sigma_m", s.depth.sigma_m, "m", 0, 5, "white noise");
  keys.number("latency_s", s.depth.latency_s, "s", 0, kMaxLatency, "from measurement to arrival");
  keys.leave();
  visitPositioning(keys, s.usbl, s.gps);
  visitWater(keys, s.water);
  visitBattery(keys, s.battery);
  visitCameraClocks(keys, s.cameras);
  keys.enter("tide", "height of the sea over nav's zero, in the pressure sensor's depth");
  keys.number("amplitude_m", s.tide.amplitude_m, "m", 0, 10, "0: no tide");
  keys.number("period_s", s.tide.period_s, "s", 60, 200000, "of the sinusoid");
  keys.angle("phase_deg", s.tide.phase, -360, 360, "at the mission's start");
  keys.integer("in_mission", s.tide.in_mission, 0, 1, "1: mission.toml predicts it; 0: it has no tide model");
  keys.leave();
  keys.enter("waves", "in the pressure sensor's depth, and in GPS at the surface");
  keys.number("height_m", s.waves.height_m, "m", 0, 10, "significant; 0: none");
  keys.number("period_s", s.waves.period_s, "s", 1, 30, "of the spectrum's peak (JONSWAP)");
  keys.angle("towards_deg", s.waves.towards, -360, 360, "where they run to, from north to east");
  keys.angle("spreading_deg", s.waves.spreading, 0, 90, "standard deviation of their directions");
  keys.leave();
  keys.enter("arrival", "of samples of DVL, compass and depth");
  keys.number("jitter_s", s.arrival.jitter_s, "s", 0, 5,
              "mean of a delay that differs from sample to sample");
  keys.number("batch_s", s.arrival.batch_s, "s", 0, 10,
              "period of the batches in which they arrive; 0: one by one");
  keys.number("stamp_jitter_s", s.arrival.stamp_jitter_s, "s", 0, 1, "standard deviation of the stamps");
  keys.leave();
  keys.leave();
}

}  // namespace fathom::sim
