#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/calibration/epipolar_check.hpp"
#include "recon/calibration/sensor_checks.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::topside {

struct MissionCheckOptions {
  std::filesystem::path mission;
  std::filesystem::path calib;            // instead of the mission's own; empty: its own
  std::size_t pairs = 200;                // looked at, in runs spread over the mission
  std::optional<double> calib_unit = {};  // of the lengths in `calib` [m], where it does not say
};

// What a mission's own images say about its rig.
struct MissionCheck {
  std::string mission, port;  // the folder; water.refractive_port of mission.toml
  StereoRig rig;              // as calibrated
  std::size_t pairs = 0, unreadable = 0, matches = 0;
  calibration::EpipolarCheck epipolar;
  std::vector<calibration::RangeSample> range_samples;
  calibration::RangeCheck range;
  std::string beams;  // which of the DVL's footprints were compared
  calibration::MountAlignment mount;
  SE3 T_body_cam;  // of mission.toml
};

// Throws InputError for a mission that cannot be read, or whose images give no match.
[[nodiscard]] MissionCheck checkMission(const MissionCheckOptions& options);

struct MissionVerdict {
  bool good = true;
  struct Line {
    enum class Kind : std::uint8_t { kGood, kBad, kOpen } kind;
    std::string text;
  };
  std::vector<Line> lines;
};
// "good", "BAD" or "open" (not observable on this mission).
[[nodiscard]] const char* nameOf(MissionVerdict::Line::Kind kind);

// With every threshold in the lines; only what is certainly bad (3 standard deviations) is called so.
[[nodiscard]] MissionVerdict judge(const MissionCheck& check);

// <folder>/mission-check.html and mission-check.json.
void writeMissionCheck(const std::filesystem::path& folder, const MissionCheck& check,
                       const MissionVerdict& verdict);

}  // namespace fathom::topside
