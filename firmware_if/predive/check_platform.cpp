#include <cmath>
#include <numbers>

#include "firmware_if/predive/predive_checks.hpp"
#include "firmware_if/predive/predive_text.hpp"

namespace fathom::io {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
// A camera that looks further than this from straight down, a DVL further than its beams' own angle, is a
// wrong angle in mission.toml rather than a mounting.
constexpr double kCameraTilt = 45 * kDegree, kDvlTilt = 30 * kDegree;
constexpr double kLeastBaseline = 0.01, kLargestBaseline = 2;  // [m]
constexpr double kLargestVergence = 20 * kDegree;              // between the two cameras' axes
constexpr double kGib = 1024.0 * 1024 * 1024;

double angleToDown(const SE3& T_body_sensor) {
  const Eigen::Vector3d axis = T_body_sensor.rotation() * Eigen::Vector3d::UnitZ();
  return std::acos(std::clamp(axis.z(), -1.0, 1.0));
}

std::uint64_t counterOf(const DeviceHealth& health, std::string_view name) {
  for (const auto& [known, value] : health.counters)
    if (known == name) return value;
  return 0;
}

// Of the mapped time against the camera's own, over the frames seen [s/s]; 0 without two seconds of them.
double driftOf(const std::vector<FrameFacts>& frames) {
  if (frames.size() < 2) return 0;
  const double device = static_cast<double>(frames.back().device_ns - frames.front().device_ns) / 1e9;
  const double utc = static_cast<double>(frames.back().utc_ns - frames.front().utc_ns) / 1e9;
  return device < 2 ? 0 : utc / device - 1;
}

}  // namespace

void checkExtrinsics(const MissionConfig& mission, const StereoRig& rig, const PrediveConfig& limits,
                     PrediveReport& report) {
  const std::array<std::pair<const char*, const SE3*>, 5> places = {
      {{"T_body_cam", &mission.T_body_cam},
       {"T_body_dvl", &mission.T_body_dvl},
       {"T_body_usbl", &mission.T_body_usbl},
       {"T_body_depth", &mission.T_body_depth},
       {"T_body_compass", &mission.T_body_compass}}};
  std::string wrong;
  for (const auto& [name, place] : places) {
    const Eigen::Matrix3d R = place->matrix3();
    const double distance = place->translation().norm();
    const bool proper =
        (R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-6 && R.determinant() > 0;
    if (!proper || !(distance <= limits.vehicle_size_m))
      wrong += std::string(wrong.empty() ? "" : ", ") + name +
               (proper ? " " + decimals(distance, 1) + " m from the body's origin" : " is no rotation");
  }
  if (wrong.empty())
    report.good("sensor places", "all within " + decimals(limits.vehicle_size_m, 1) + " m, rotations proper");
  else
    report.bad("sensor places", wrong,
               "correct [extrinsics] of mission.toml (metres, radians), or predive.vehicle_size_m");

  const double camera = angleToDown(mission.T_body_cam), dvl = angleToDown(mission.T_body_dvl);
  const std::string tilts = "camera " + decimals(camera / kDegree, 1) + " deg, DVL " +
                            decimals(dvl / kDegree, 1) + " deg from straight down";
  if (camera <= kCameraTilt && dvl <= kDvlTilt)
    report.good("looking down", tilts);
  else
    report.bad("looking down", tilts,
               std::string("correct the angles of ") + (camera > kCameraTilt ? "T_body_cam" : "T_body_dvl") +
                   " in mission.toml: z points out of the lens, body's z is down");

  const Eigen::Vector3d right_in_left = rig.T_right_left.inverse().translation();
  const double vergence = Eigen::AngleAxisd(rig.T_right_left.rotation()).angle();
  const double length = right_in_left.norm();
  const std::string found = "right camera " + decimals(1e3 * right_in_left.x(), 1) +
                            " mm to the right of the left, axes " + decimals(vergence / kDegree, 1) +
                            " deg apart";
  if (right_in_left.x() <= 0)
    report.bad("stereo rig", found,
               "left and right are exchanged in stereo.calib: calibrate with left first");
  else if (length < kLeastBaseline || length > kLargestBaseline || right_in_left.x() < 0.7 * length ||
           vergence > kLargestVergence)
    report.bad("stereo rig", found,
               "no such rig exists: translations of stereo.calib are in metres; calibrate anew");
  else
    report.good("stereo rig", found);
}

void checkClocks(const PrediveFacts& facts, const rt::SystemClockState& system, const PrediveConfig& limits,
                 PrediveReport& report) {
  if (!system.known) {
    report.unused("system clock", "the system does not tell");
  } else {
    const std::string found = std::string(system.synchronised ? "synchronised" : "not synchronised") +
                              (system.pps ? " by a pulse a second" : "") + ", error at most " +
                              decimals(system.error_s * 1e3, 1) + " ms";
    if (system.synchronised && system.error_s <= limits.clock_error_s)
      report.good("system clock", found);
    else if (!limits.system_clock)
      report.unused("system clock", found);
    else
      report.bad("system clock", found,
                 "start chrony (or ptp4l) with a source on deck and wait: chronyc waitsync");
  }
  for (std::size_t side = 0; side < facts.cameras.size(); ++side) {
    const CameraFacts& camera = facts.cameras[side];
    if (!camera.used || camera.frames.size() < 2) continue;
    const std::string name = side == 0 ? "clock of left camera" : "clock of right camera";
    const std::uint64_t resets = counterOf(camera.health, "clock_resets");
    const std::string found =
        "drifts " + decimals(driftOf(camera.frames) * 1e6, 0) + " ppm, " + plural(resets, "leap");
    if (resets == 0)
      report.good(name, found);
    else
      report.bad(name, found,
                 "the camera started again or PTP moved its clock: look at its power and at ptp4l");
  }
  for (const DeviceHealth& source : facts.sources) {
    if (source.name != "dvl" || source.samples == 0) continue;
    const std::uint64_t leaps = counterOf(source, "clock_leaps"), late = counterOf(source, "late");
    const std::string found = decimals(static_cast<double>(counterOf(source, "clock_offset_ms")) / 1e3, 2) +
                              " s from the vehicle's, followed; " + plural(leaps, "leap") + ", " +
                              std::to_string(late) + " late";
    if (leaps == 0)
      report.good("clock of DVL", found);
    else
      report.bad("clock of DVL", found, "set the DVL's clock (TS) once, or dvl.clock = \"arrival\"");
  }
}

void checkDisk(const RecorderConfig& recorder, const MissionConfig& mission, const StereoRig& rig,
               std::uint64_t free_bytes, PrediveReport& report) {
  const double planned = static_cast<double>(plannedBytes(recorder, mission, rig).total()) / kGib +
                         recorder.image_reserve_mib / 1024;
  const double free = static_cast<double>(free_bytes) / kGib;
  const std::string found = decimals(free, 1) + " GiB free, " + decimals(planned, 1) + " GiB wanted for " +
                            decimals(recorder.planned_hours, 1) + " h";
  if (free_bytes == 0)
    report.bad("disk", "the system does not tell", "look whether the mission folder's disk is mounted");
  else if (free >= planned)
    report.good("disk", found);
  else
    report.bad("disk", found, "make room, or set recorder.planned_hours to what the dive takes");
}

void checkArming(const rt::ArmingResult& arming, PrediveReport& report) {
  for (const rt::ArmingCheck& check : arming.checks) {
    if (check.ok)
      report.good(check.name, check.found);
    else if (check.required)
      report.bad(check.name, check.missing.empty() ? check.found : check.missing, check.grant);
    else
      report.unused(check.name, check.missing.empty() ? check.found : check.missing);
  }
}

}  // namespace fathom::io
