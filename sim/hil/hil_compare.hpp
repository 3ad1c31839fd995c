#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware_if/files/pose_files.hpp"
#include "sim/hil/camera_log.hpp"

namespace fathom::sim {

struct HilComparison {
  std::filesystem::path run;      // RUN of fathom-sim hil
  std::filesystem::path mission;  // what was played
  std::string onboard;            // fathom-onboard
};

// fathom-sim hil-compare: what a bench run is held to. Replays the recording and the mission where that was
// not done yet (RUN/replay, RUN/direct), prints the tables, writes RUN/compare.json. True when every check
// holds:
//   replay       the recording replays to the bytes that the live run wrote
//   poses        camera positions within 3 mm of the direct replay's, where the first lap shows the same
//   pair,
//                after the turn about the vertical and the shift that the whole track has; these no more than
//                the position's claimed standard deviation. Ship's fixes come over the modem later than they
//                stand in the mission: one that comes after the first pair weighs otherwise than one before
//   frames       every whole frame that a camera sent is recorded, up to those that a full disk stopped
//   pairs        no pair of exposures that do not belong together, no pixel other than the mission's
//   faults       each counter that a fault must move has the count injected
// A run with faults is not held to the poses: their distance is its effect. Throws InputError for a folder
// that is no run.
bool compareHil(const HilComparison& what);

// The parts, for tests.

// Names of the files that differ between two folders or are in only one; but those that hold measured times
// (timing.json, live.json).
[[nodiscard]] std::vector<std::string> differingFiles(const std::filesystem::path& a,
                                                      const std::filesystem::path& b);

// From vehicle time to the mission's, on the first lap.
struct TimeShift {
  std::int64_t start_utc_ns = 0, mission_begin_utc_ns = 0;
  double rate = 1;
  [[nodiscard]] double missionUtc(double vehicle_utc_s) const;
};
struct PoseDistances {
  std::size_t matched = 0, unmatched = 0;  // of the live run's poses; unmatched: no direct pose within 0.1 s
  double moved_m = 0, turn_rad = 0;        // the whole: furthest motion of a pose, turn about the vertical
  double worst_m = 0, rms_m = 0, worst_rad = 0;  // of single poses, without that motion
};
[[nodiscard]] PoseDistances comparePoses(const io::StereoPoseFile& live, const io::StereoPoseFile& direct,
                                         const TimeShift& shift);

struct PairCheck {
  std::size_t pairs = 0;
  std::size_t mismatched = 0;  // its images were not exposed together
  std::size_t unknown = 0;     // an image that no camera exposed
};
// The pairs of a pose file against what the cameras exposed. `tolerance_s`: largest difference of exposures.
[[nodiscard]] PairCheck checkPairs(const io::StereoPoseFile& live, const std::vector<CameraLogRow>& left,
                                   const std::vector<CameraLogRow>& right, double tolerance_s);

// The exposure nearest to a time within 50 ms; nullptr for none.
[[nodiscard]] const CameraLogRow* exposureAt(const std::vector<CameraLogRow>& log, std::int64_t utc_ns);

}  // namespace fathom::sim
