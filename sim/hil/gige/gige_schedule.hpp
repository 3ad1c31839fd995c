#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/sensor_samples.hpp"
#include "sim/hil/fault_script.hpp"

namespace fathom::sim {

// One exposure of a simulated camera, and what goes wrong with it.
struct GigeExposure {
  double mission_s = 0;  // since the first played moment, without faults
  std::string file;      // of img/
  double late_s = 0;     // exposed so much later
  bool lost = false;     // nothing of it is sent
  int lost_packets = 0;  // of it
  bool resend = false;   // the lost packets are sent when they are asked for
  int frame_id = 0;      // it has this one; 0: the next
  bool away = false;     // the camera is starting again
};

struct GigeReboot {
  double at_s = 0, for_s = 0;  // mission seconds
};

struct GigeSchedule {
  std::vector<GigeExposure> exposures;  // in rising order
  std::vector<GigeReboot> reboots;      // in rising order
};

// Exposures of one side from the image events of the mission's log; `first_utc_ns` is mission second 0,
// before which nothing is played. Throws InputError for a mission without images of this side.
[[nodiscard]] std::vector<GigeExposure> missionExposures(const std::filesystem::path& mission,
                                                         CameraSide side, std::int64_t first_utc_ns);
// The same from lines "<mission second>,<file of img/>", in rising order. Throws InputError naming the line.
[[nodiscard]] std::vector<GigeExposure> listedExposures(const std::filesystem::path& list);

// Gives each exposure the faults that the script has for this camera.
[[nodiscard]] GigeSchedule withFaults(std::vector<GigeExposure> exposures, const FaultScript& script,
                                      CameraSide side);

}  // namespace fathom::sim
