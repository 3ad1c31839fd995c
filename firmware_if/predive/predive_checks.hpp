#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include "firmware_if/devices/camera/camera_config.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/predive/predive_watch.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "realtime/base/config_keys.hpp"
#include "realtime/kernel/threads/arming.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// "1 frame", "2 frames".
inline std::string plural(std::uint64_t count, const std::string& thing) {
  return std::to_string(count) + " " + thing + (count == 1 ? "" : "s");
}

enum class PrediveVerdict { kGood, kBad, kAdvice, kUnused };

// One line of the table: what was checked, what was found and, for a red one, what to do about it.
struct PrediveRow {
  std::string name;
  PrediveVerdict verdict = PrediveVerdict::kGood;
  std::string found;
  std::string fix;  // of a red row, or of advice
};

struct PrediveReport {
  std::vector<PrediveRow> rows;
  [[nodiscard]] bool allGood() const;
  void good(std::string name, std::string found) {
    rows.push_back({std::move(name), PrediveVerdict::kGood, std::move(found), ""});
  }
  void bad(std::string name, std::string found, std::string fix) {
    rows.push_back({std::move(name), PrediveVerdict::kBad, std::move(found), std::move(fix)});
  }
  // The fix of the first fault that is there; good without one.
  void judge(const std::string& name, const std::string& found,
             std::initializer_list<std::pair<bool, std::string>> faults) {
    for (const auto& [there, fix] : faults)
      if (there) return bad(name, found, fix);
    good(name, found);
  }
  // The vehicle can dive as it is, and would be better off with the fix.
  void advise(std::string name, std::string found, std::string fix) {
    rows.push_back({std::move(name), PrediveVerdict::kAdvice, std::move(found), std::move(fix)});
  }
  void unused(std::string name, std::string found) {
    rows.push_back({std::move(name), PrediveVerdict::kUnused, std::move(found), ""});
  }
};

// A line a row, a second one with the fix below a red row or a note, a summary; with colours for a terminal.
[[nodiscard]] std::string reportTable(const PrediveReport& report, bool colours);
// {"good": false, "rows": [{"name", "verdict": "good"|"bad"|"advice"|"unused", "found", "fix"}]}
[[nodiscard]] std::string reportJson(const PrediveReport& report);

// Table `[predive]` of onboard.toml: limits of a good state before the launch.
struct PrediveConfig {
  // Least rates [Hz]; a device passes with 80 % of them.
  double dvl_hz = 2, compass_hz = 5, depth_hz = 1;
  double edge_px = 5;             // widest that the sharpest edges of an image may be (predive_watch.hpp)
  double saturated_share = 0.05;  // most of an image's pixels that may be saturated
  double mean_min = 0.03, mean_max = 0.8;  // of an image, of full scale
  double pair_offset_s = 0.01;  // largest median and largest spread of the time between left and right
  double deck_depth_m = 5;      // the pressure sensor shows no more than this on deck
  double deck_tilt_deg = 45;    // largest roll or pitch of a vehicle on deck
  double origin_km = 50;        // no fix is further from the mission's origin
  double least_charge = 0.2;    // of the battery, 0 to 1
  double vehicle_size_m = 5;    // no sensor is further from the body's origin
  bool system_clock = true;     // the system's clock must be synchronised; else it is noted only
  double clock_error_s = 0.1;   // largest error that the system states of its own clock
};
void visitPredive(KeyVisitor& keys, PrediveConfig& config);

// Each check adds green or red rows, notes or unused ones for what was read and measured; pure functions.

// Sensors' places on the vehicle and the stereo rig, as mission.toml and stereo.calib have them.
void checkExtrinsics(const MissionConfig& mission, const StereoRig& rig, const PrediveConfig& limits,
                     PrediveReport& report);

// Each camera: present, the one of the calibration, size and rate, focus, exposure. Then the pair: exposed
// together, equally lit.
void checkCameras(const PrediveFacts& facts, const StereoCameraConfig& cameras, const MissionConfig& mission,
                  const StereoRig& rig, const PrediveConfig& limits, PrediveReport& report);

// DVL, compass, depth, battery, GPS, USBL and modem: alive, at their rates. `origin`: of the mission, which
// no fix is far from.
void checkSensors(const PrediveFacts& facts, const MissionConfig& mission, const PrediveConfig& limits,
                  PrediveReport& report);

// System's, cameras' and DVL's clocks.
void checkClocks(const PrediveFacts& facts, const rt::SystemClockState& system, const PrediveConfig& limits,
                 PrediveReport& report);

// Room on the disk for the planned hours; memory and privileges for real time.
void checkDisk(const RecorderConfig& recorder, const MissionConfig& mission, const StereoRig& rig,
               std::uint64_t free_bytes, PrediveReport& report);
void checkArming(const rt::ArmingResult& arming, PrediveReport& report);

}  // namespace fathom::io
