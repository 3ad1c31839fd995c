#include "firmware_if/predive/predive_checks.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <type_traits>
#include <variant>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

// A camera that looks further than this from straight down, a DVL further than its beams' own angle, is a
// wrong angle in mission.toml rather than a mounting.
constexpr double kCameraTilt = 45 * kRadiansPerDegree, kDvlTilt = 30 * kRadiansPerDegree;
constexpr double kLeastBaseline = 0.01, kLargestBaseline = 2;  // [m]
constexpr double kLargestVergence = 20 * kRadiansPerDegree;    // between the two cameras' axes

double angleToDown(const SE3& T_body_sensor) {
  const Eigen::Vector3d axis = T_body_sensor.rotation() * Eigen::Vector3d::UnitZ();
  return std::acos(std::clamp(axis.z(), -1.0, 1.0));
}

// Drift of the mapped time against the camera's own over the frames [s/s]; 0 without two seconds of them.
double driftOf(const std::vector<FrameFacts>& frames) {
  if (frames.size() < 2) return 0;
  const double device = static_cast<double>(frames.back().device_ns - frames.front().device_ns) / 1e9;
  const double utc = static_cast<double>(frames.back().utc_ns - frames.front().utc_ns) / 1e9;
  return device < 2 ? 0 : utc / device - 1;
}

constexpr double kRateShare = 0.8;        // of the least rate with which a device passes
constexpr double kDamagedShare = 0.05;    // of the ensembles: a bad line
constexpr double kEarthRadius = 6.371e6;  // [m]

// The place of a kind of sample in SensorSample.
template <class Sample>
const std::size_t kKind = SensorSample(Sample{}).index();

const DeviceHealth* sourceNamed(const PrediveFacts& facts, std::string_view name) {
  for (const DeviceHealth& source : facts.sources)
    if (source.name == name) return &source;
  return nullptr;
}

double metresFromOrigin(const MissionConfig& mission, double latitude, double longitude) {
  const double north = latitude - mission.origin.latitude;
  const double east = std::remainder(longitude - mission.origin.longitude, 2 * std::numbers::pi) *
                      std::cos(mission.origin.latitude);
  return kEarthRadius * hypotenuse(north, east);
}

std::string rateText(const SampleFacts& facts, double wanted_hz) {
  return decimals(facts.rateHz(), 1) + " Hz of " + decimals(wanted_hz, 1) + ", longest gap " +
         decimals(facts.longest_gap_s, 2) + " s";
}

bool slow(const SampleFacts& facts, double wanted_hz) {
  return facts.rateHz() < kRateShare * wanted_hz;
}

void checkDvl(const PrediveFacts& facts, const PrediveConfig& limits, PrediveReport& report) {
  const SampleFacts& dvl = facts.samples[kKind<DvlSample>];
  const DeviceHealth* source = sourceNamed(facts, "dvl");
  const auto counter = [&](std::string_view name) { return source == nullptr ? 0 : source->counter(name); };
  const std::uint64_t ensembles = counter("ensembles"), bad = counter("bad_checksum");
  const auto refuse = [&](const std::string& found, const std::string& fix) {
    report.bad("DVL", found, fix);
  };
  if (!facts.expected[kKind<DvlSample>])
    return refuse("none is configured", "set dvl.device, or add dvl to lcm.accept, in onboard.toml");
  if (dvl.count == 0) {
    if (source == nullptr) return refuse("silent on LCM", "start the program that publishes RDI");
    if (!source->open)
      return refuse(
          "its line is not there" + (source->reason.empty() ? "" : ": " + std::string(source->reason.view())),
          "look at the cable and at dvl.device; end programs that use the line");
    if (counter("bytes") == 0)
      return refuse("silent", "look at its power and cable; it must ping by itself (CS)");
    if (ensembles == 0)
      return refuse(std::to_string(counter("bytes")) + " bytes, but no ensemble",
                    "look at the baud rate of dvl.device and at dvl.format");
    return refuse(plural(ensembles, "ensemble") + " without bottom track", "switch bottom track on (BP1)");
  }
  const std::string found =
      rateText(dvl, limits.dvl_hz) +
      (dvl.usable == 0
           ? ", no bottom lock (as in air)"
           : ", velocity in " +
                 decimals(100.0 * static_cast<double>(dvl.usable) / static_cast<double>(dvl.count), 0) +
                 " %");
  if (static_cast<double>(bad) > kDamagedShare * static_cast<double>(ensembles + bad))
    return refuse(found + ", " + plural(bad, "damaged ensemble"), "look at cable, ground and baud rate");
  report.judge("DVL", found,
               {{slow(dvl, limits.dvl_hz), "look at its ping rate (TP, TE), or set predive.dvl_hz"}});
}

// False, and reported, where a sensor that must be there gives nothing. `word`: of lcm.accept.
bool givesSamples(const PrediveFacts& facts, std::size_t kind, const std::string& name,
                  const std::string& word, PrediveReport& report) {
  if (!facts.expected[kind])
    report.bad(name, "none is configured",
               "set can.interface, or add " + word + " to lcm.accept, in onboard.toml");
  else if (facts.samples[kind].count == 0)
    report.bad(name, "silent",
               "look at its power, at the bus (candump, lcm-spy) and at the program that publishes it");
  return facts.expected[kind] && facts.samples[kind].count > 0;
}

void checkCompass(const PrediveFacts& facts, const PrediveConfig& limits, PrediveReport& report) {
  if (!givesSamples(facts, kKind<AttitudeSample>, "compass", "attitude", report)) return;
  const SampleFacts& samples = facts.samples[kKind<AttitudeSample>];
  const auto& attitude = std::get<AttitudeSample>(samples.last);
  const std::string found = rateText(samples, limits.compass_hz) + "; heading " +
                            decimals(attitude.heading / kRadiansPerDegree, 1) + ", roll " +
                            decimals(attitude.roll / kRadiansPerDegree, 1) + ", pitch " +
                            decimals(attitude.pitch / kRadiansPerDegree, 1) + " deg";
  report.judge("compass", found,
               {{slow(samples, limits.compass_hz), "raise its rate, or set predive.compass_hz"},
                {std::max(std::abs(attitude.roll), std::abs(attitude.pitch)) >
                     limits.deck_tilt_deg * kRadiansPerDegree,
                 "no vehicle on deck has this attitude: look at how the compass is mounted, at its units and "
                 "predive.deck_tilt_deg"}});
}

void checkDepth(const PrediveFacts& facts, const PrediveConfig& limits, PrediveReport& report) {
  if (!givesSamples(facts, kKind<DepthSample>, "depth", "depth", report)) return;
  const SampleFacts& samples = facts.samples[kKind<DepthSample>];
  const double depth = std::get<DepthSample>(samples.last).depth;
  report.judge(
      "depth", rateText(samples, limits.depth_hz) + "; " + decimals(depth, 2) + " m",
      {{slow(samples, limits.depth_hz), "raise its rate, or set predive.depth_hz"},
       {std::abs(depth) > limits.deck_depth_m,
        "the vehicle is on deck: zero the pressure sensor, look at its units and predive.deck_depth_m"}});
}

void checkPositions(const PrediveFacts& facts, const MissionConfig& mission, const PrediveConfig& limits,
                    PrediveReport& report) {
  const SampleFacts& gps = facts.samples[kKind<GpsFix>];
  const auto place = [&](const char* name, double latitude, double longitude, double sigma) {
    const double distance_m = metresFromOrigin(mission, latitude, longitude);
    const std::string found =
        decimals(latitude / kRadiansPerDegree, 5) + ", " + decimals(longitude / kRadiansPerDegree, 5) +
        " deg, sigma " + decimals(sigma, 1) + " m, " + decimals(distance_m / 1e3, 1) + " km from the origin";
    report.judge(name, found,
                 {{!(distance_m <= 1e3 * limits.origin_km),
                   "correct origin_latitude and origin_longitude of mission.toml, or the ship's position"}});
  };
  if (gps.count > 0) {
    const auto& fix = std::get<GpsFix>(gps.last);
    place("GPS", fix.latitude, fix.longitude, fix.sigma_horizontal);
  } else if (facts.expected[kKind<GpsFix>]) {
    report.bad("GPS", "silent", "look at its antenna and at the program that publishes it");
  } else {
    report.unused("GPS", "not used");
  }
  const SampleFacts& usbl = facts.samples[kKind<UsblFix>];
  if (usbl.count > 0) {
    const auto& fix = std::get<UsblFix>(usbl.last);
    place("USBL", fix.latitude, fix.longitude, fix.sigma_horizontal);
  } else if (facts.expected[kKind<UsblFix>] || facts.modem.used) {
    report.bad(
        "USBL", "no fix came in " + decimals(facts.seconds, 0) + " s",
        "start the ship's USBL and fathom-monitor, transponder in the water; look longer: --seconds 60");
  } else {
    report.unused("USBL", "not used");
  }
}

void checkBattery(const PrediveFacts& facts, const PrediveConfig& limits, PrediveReport& report) {
  const SampleFacts& samples = facts.samples[kKind<BatterySample>];
  if (samples.count == 0) {
    if (facts.expected[kKind<BatterySample>])
      report.bad("battery", "silent", "look at the program that publishes it");
    else
      report.unused("battery", "not reported");
    return;
  }
  const auto& battery = std::get<BatterySample>(samples.last);
  const std::string found =
      (battery.voltage ? decimals(*battery.voltage, 1) + " V" : std::string("voltage not reported")) +
      (battery.charge ? ", " + decimals(100 * *battery.charge, 0) + " % left" : "");
  report.judge("battery", found, {{battery.charge && *battery.charge < limits.least_charge, "charge it"}});
}

void checkModem(const ModemFacts& modem, PrediveReport& report) {
  if (!modem.used) return report.unused("modem", "not used");
  if (!modem.open)
    return report.bad("modem", modem.failure, "correct modem.device in onboard.toml, or the cable");
  const std::string found = plural(modem.frames, "frame") + " received, " + std::to_string(modem.ours) +
                            " for this vehicle, " + std::to_string(modem.broken) + " broken";
  report.judge(
      "modem", found,
      {{modem.frames == 0,
        "let fathom-monitor speak on the ship, transducers in one water; look longer: --seconds 60"},
       {modem.ours == 0,
        "the ship speaks to another vehicle or dive: compare vehicle_id and dive_id of mission.toml"}});
}

}  // namespace

void visitPredive(KeyVisitor& keys, PrediveConfig& c) {
  keys.number("dvl_hz", c.dvl_hz, "Hz", 0.01, 100, "least rate of the DVL; 80 % of it passes");
  keys.number("compass_hz", c.compass_hz, "Hz", 0.01, 1000, "of the compass");
  keys.number("depth_hz", c.depth_hz, "Hz", 0.01, 1000, "of the depth sensor");
  keys.number("edge_px", c.edge_px, "px", 2, 100, "widest that the sharpest edges of an image may be");
  keys.number("saturated_share", c.saturated_share, "of the pixels", 0, 1, "most that may be saturated");
  keys.number("mean_min", c.mean_min, "of full scale", 0, 1, "darkest mean of an image");
  keys.number("mean_max", c.mean_max, "of full scale", 0, 1, "brightest");
  keys.number("pair_offset_s", c.pair_offset_s, "s", 1e-6, 1, "median and spread of right against left");
  keys.number("deck_depth_m", c.deck_depth_m, "m", 0, 12000, "most that the depth sensor may show on deck");
  keys.number("deck_tilt_deg", c.deck_tilt_deg, "deg", 1, 90, "largest roll and pitch on deck");
  keys.number("origin_km", c.origin_km, "km", 0.1, 20'000, "farthest fix from the mission's origin");
  keys.number("least_charge", c.least_charge, "1", 0, 1, "of the battery");
  keys.number("vehicle_size_m", c.vehicle_size_m, "m", 0.1, 100, "farthest sensor from the body's origin");
  keys.boolean("system_clock", c.system_clock, "it must be synchronised; false: noted only");
  keys.number("clock_error_s", c.clock_error_s, "s", 1e-6, 1000,
              "largest stated error of the system's clock");
}

void checkExtrinsics(const MissionConfig& mission, const StereoRig& rig, const PrediveConfig& limits,
                     PrediveReport& report) {
  std::string wrong;
  for (const auto& [name, place] : MissionConfig::posesOf(mission)) {
    const Eigen::Matrix3d R = place->matrix3();
    const double distance = place->translation().norm();
    const bool proper =
        (R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-6 && R.determinant() > 0;
    if (!proper || !(distance <= limits.vehicle_size_m))
      wrong += std::string(wrong.empty() ? "" : ", ") + name +
               (proper ? " " + decimals(distance, 1) + " m from the body's origin" : " is no rotation");
  }
  report.judge(
      "sensor places",
      wrong.empty() ? "all within " + decimals(limits.vehicle_size_m, 1) + " m, rotations proper" : wrong,
      {{!wrong.empty(),
        "correct [extrinsics] of mission.toml (metres, radians), or predive.vehicle_size_m"}});

  const double camera = angleToDown(mission.T_body_cam), dvl = angleToDown(mission.T_body_dvl);
  const std::string tilts = "camera " + decimals(camera / kRadiansPerDegree, 1) + " deg, DVL " +
                            decimals(dvl / kRadiansPerDegree, 1) + " deg from straight down";
  report.judge(
      "looking down", tilts,
      {{!(camera <= kCameraTilt && dvl <= kDvlTilt),
        std::string("correct the angles of ") + (camera > kCameraTilt ? "T_body_cam" : "T_body_dvl") +
            " in mission.toml: z points out of the lens, body's z is down"}});

  const Eigen::Vector3d right_in_left = rig.T_right_left.inverse().translation();
  const double vergence = Eigen::AngleAxisd(rig.T_right_left.rotation()).angle();
  const double length = right_in_left.norm();
  const std::string found = "right camera " + decimals(1e3 * right_in_left.x(), 1) +
                            " mm to the right of the left, axes " +
                            decimals(vergence / kRadiansPerDegree, 1) + " deg apart";
  report.judge(
      "stereo rig", found,
      {{right_in_left.x() <= 0, "left and right are exchanged in stereo.calib: calibrate with left first"},
       {length < kLeastBaseline || length > kLargestBaseline || right_in_left.x() < 0.7 * length ||
            vergence > kLargestVergence,
        "no such rig exists: translations of stereo.calib are in metres; calibrate again"}});
}

void checkClocks(const PrediveFacts& facts, const rt::SystemClockState& system, const PrediveConfig& limits,
                 PrediveReport& report) {
  if (!system.known) {
    report.unused("system clock", "unknown to the system");
  } else {
    const std::string found = std::string(system.synchronised ? "synchronised" : "not synchronised") +
                              (system.pps ? " by a pulse a second" : "") + ", error at most " +
                              decimals(system.error_s * 1e3, 1) + " ms";
    const bool bad = !(system.synchronised && system.error_s <= limits.clock_error_s);
    if (bad && !limits.system_clock)
      report.unused("system clock", found);
    else
      report.judge("system clock", found,
                   {{bad, "start chrony (or ptp4l) with a source on deck and wait: chronyc waitsync"}});
  }
  for (std::size_t side = 0; side < facts.cameras.size(); ++side) {
    const CameraFacts& camera = facts.cameras[side];
    if (!camera.used || camera.frames.size() < 2) continue;
    const std::string name = side == 0 ? "clock of left camera" : "clock of right camera";
    const std::uint64_t resets = camera.health.counter("clock_resets");
    const std::string found =
        "drifts " + decimals(driftOf(camera.frames) * 1e6, 0) + " ppm, " + plural(resets, "leap");
    report.judge(
        name, found,
        {{resets != 0, "the camera started again or PTP moved its clock: look at its power and at ptp4l"}});
  }
  if (const DeviceHealth* dvl = sourceNamed(facts, "dvl"); dvl != nullptr && dvl->samples > 0) {
    const std::uint64_t leaps = dvl->counter("clock_leaps"), late = dvl->counter("late");
    const std::string found = decimals(static_cast<double>(dvl->counter("clock_offset_ms")) / 1e3, 2) +
                              " s from the vehicle's, followed; " + plural(leaps, "leap") + ", " +
                              std::to_string(late) + " late";
    report.judge("clock of DVL", found,
                 {{leaps != 0, "set the DVL's clock (TS) once, or dvl.clock = \"arrival\""}});
  }
}

void checkDisk(const RecorderConfig& recorder, const MissionConfig& mission, const StereoRig& rig,
               std::uint64_t free_bytes, PrediveReport& report) {
  const double planned = static_cast<double>(plannedBytes(recorder, mission, rig).total()) / kGiB +
                         recorder.image_reserve_mib / 1024;
  const double free = static_cast<double>(free_bytes) / kGiB;
  const std::string found = decimals(free, 1) + " GiB free, " + decimals(planned, 1) + " GiB wanted for " +
                            decimals(recorder.planned_hours, 1) + " h";
  if (free_bytes == 0)
    report.bad("disk", "unknown to the system", "look whether the mission folder's disk is mounted");
  else
    report.judge("disk", found,
                 {{!(free >= planned), "make room, or set recorder.planned_hours to what the dive takes"}});
}

void checkArming(const rt::ArmingResult& arming, PrediveReport& report) {
  for (const rt::ArmingCheck& check : arming.checks) {
    if (check.ok)
      report.good(check.name, check.found);
    else if (check.required)
      report.bad(check.name, check.missing.empty() ? check.found : check.missing, check.grant);
    else
      report.advise(check.name, check.missing, check.grant);
  }
}

void checkSensors(const PrediveFacts& facts, const MissionConfig& mission, const PrediveConfig& limits,
                  PrediveReport& report) {
  checkDvl(facts, limits, report);
  checkCompass(facts, limits, report);
  checkDepth(facts, limits, report);
  checkPositions(facts, mission, limits, report);
  checkBattery(facts, limits, report);
  checkModem(facts.modem, report);
}

}  // namespace fathom::io
