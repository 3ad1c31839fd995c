#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/sensor_samples.hpp"
#include "sim/hil/fault_script.hpp"

namespace fathom::sim {

// One exposure of a simulated camera with its faults.
struct GigeExposure {
  double mission_s = 0;  // since the begin of playing, without faults
  std::string file;      // of img/
  double late_s = 0;     // delay of the exposure
  bool lost = false;     // not sent
  int lost_packets = 0;  // number of lost packets
  bool resend = false;   // lost packets are sent on request
  int frame_id = 0;      // its number; 0: the next
  bool away = false;     // the camera is restarting
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

// Adds the script's faults of this camera to the exposures.
[[nodiscard]] GigeSchedule withFaults(std::vector<GigeExposure> exposures, const FaultScript& script,
                                      CameraSide side);

}  // namespace fathom::sim
