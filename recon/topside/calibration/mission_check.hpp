#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/calibration/sensor_checks.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/topside/calibration/free_matches.hpp"

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

// Stereo's seafloor as mean depths on a grid in plan, to be asked where the DVL's beams fell: beams and
// camera look at different places at any one moment, but the vehicle passes over both.
class RangeMap {
 public:
  void add(const SE3& T_nav_cam, const std::vector<SeenPoint>& points);

  // Mean depth [m] and mean range below the cameras that saw it [m] over places in plan (north, east), each
  // the mean of the 0.3 m about it, about a DVL beam's footprint; std::nullopt when fewer than `enough` of
  // them were seen.
  struct Seen {
    double depth = 0, range = 0;
  };
  [[nodiscard]] std::optional<Seen> at(const std::vector<Eigen::Vector2d>& places, int enough) const;

 private:
  static constexpr double kCell = 0.1;  // [m]
  struct Cell {
    double depth = 0, range = 0;
    int points = 0;
  };
  [[nodiscard]] static std::pair<std::int64_t, std::int64_t> cellOf(double north, double east);
  std::map<std::pair<std::int64_t, std::int64_t>, Cell> cells_;
};

}  // namespace fathom::topside
