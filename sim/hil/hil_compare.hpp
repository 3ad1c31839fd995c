#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware_if/mission/pose_files.hpp"
#include "sim/hil/fault_table.hpp"

namespace fathom::sim {

struct HilComparison {
  std::filesystem::path run;      // RUN of fathom-sim hil
  std::filesystem::path mission;  // what was played
  std::string onboard;            // fathom-onboard
};

// fathom-sim hil-compare: checks a bench run. Replays the recording and the mission unless done already
// (RUN/replay, RUN/direct), prints the tables and writes RUN/compare.json. True when every check passes:
//   replay  the recording replays to the bytes that the live run wrote
//   poses   camera positions of the first lap within 3 mm of the direct replay's, after the common rotation
//   about
//           the vertical and translation of the track, which are within the position's stated standard
//           deviation. (Fixes arrive later over the modem than in the mission; one that arrives after the
//           first pair has another weight than one before.)
//   frames  every complete frame that a camera sent is recorded, except those refused by a full disk
//   pairs   every pair is of one instant, every pixel is the mission's
//   faults  each counter that a fault must move has the injected count
// With faults other than the mapper's, the check of poses is informative only. Throws InputError for a folder
// that is no run.
bool compareHil(const HilComparison& comparison);

// The parts of compareHil().

// Names of the files that differ between two folders or are in only one, without those of measured times
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
  double moved_m = 0, turn_rad = 0;  // common motion: farthest of a pose, and rotation about the vertical
  double worst_m = 0, rms_m = 0, worst_rad = 0;  // of single poses, without the common motion
};
[[nodiscard]] PoseDistances comparePoses(const io::StereoPoseFile& live, const io::StereoPoseFile& direct,
                                         const TimeShift& shift);

struct PairCheck {
  std::size_t pairs = 0;
  std::size_t mismatched = 0;  // its images were not exposed together
  std::size_t unknown = 0;     // an image without an exposure
};
// Compares the pairs of a pose file with the cameras' exposures. `tolerance_s`: largest difference of
// exposures.
[[nodiscard]] PairCheck checkPairs(const io::StereoPoseFile& live, const std::vector<CameraLogRow>& left,
                                   const std::vector<CameraLogRow>& right, double tolerance_s);

// The exposure nearest to a time within 50 ms; nullptr for none.
[[nodiscard]] const CameraLogRow* exposureAt(const std::vector<CameraLogRow>& log, std::int64_t utc_ns);

}  // namespace fathom::sim
