#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>

#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

struct MissionMakerOptions {
  std::filesystem::path out;
  bool force = false;     // replaces a folder that is not empty
  int threads = 0;        // 0: as many as the machine has
  bool features = false;  // features/ (simulated stereo features) in place of img/
  // Called after each pair, one call at a time.
  std::function<void(std::size_t done, std::size_t total)> progress;
};

struct MissionMakerReport {
  std::size_t pairs = 0;
  std::size_t samples = 0;             // in sensors.lcmlog
  double survey_s = 0;                 // from the first to the last pair
  double track_m = 0;                  // flown in that time
  double lowest_m = 0, highest_m = 0;  // altitude over the seafloor in that time
};

// Writes a mission folder with its truth, as "<out>.partial", which is renamed to `out` when complete. The
// bytes depend on the scenario only. Throws InputError for a folder in use and for a scenario that cannot be
// flown, std::runtime_error for a failure of the disk.
MissionMakerReport makeMission(const Scenario& scenario, const MissionMakerOptions& options);

}  // namespace fathom::sim
