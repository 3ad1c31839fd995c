#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware_if/files/mission.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/hil/fault_script.hpp"

namespace fathom::sim {

struct ScheduleOptions {
  // Vehicle time before which it does not begin. It begins within a second of it, at a whole number of
  // seconds from the mission's, so that hundredths and milliseconds of stamps stay what they were.
  std::int64_t start_utc_ns = 0;
  double from_s = 0;   // begins so long after the mission's first sample [s]
  double seconds = 0;  // of the mission; 0: to its end
  double rate = 1;     // mission seconds a second; velocities grow with it
  // The mission flown forward, then backward, then forward again: what the vehicle saw and felt on the way
  // back is the same, its velocity the opposite. A short mission lasts as long as a bench needs.
  int laps = 1;
  // Before and after it the vehicle lies still and its instruments go on: first and last attitude and depth,
  // no velocity over the ground [s].
  double lie_before_s = 0, lie_after_s = 0;
};

// A sample, its times those of the vehicle's clock, and when the device says it.
struct ScheduledSample {
  std::int64_t due_utc_ns = 0;
  SensorSample sample;
};
struct ScheduledExposure {
  std::int64_t utc_ns = 0;  // of the exposure, true as far as the mission knows
  CameraSide side = CameraSide::kLeft;
  std::string file_name;  // in the mission's img/
  double exposure_s = 0;
};

// What every device of the vehicle does on the bench, in vehicle time: a recorded or simulated mission moved
// to now. What mission.toml knows of the offsets of the devices' clocks is put right, so that the vehicle is
// given offsets of zero.
struct MissionSchedule {
  io::MissionConfig mission;  // as the vehicle is to read it: start, rate and clock offsets changed
  StereoRig rig;
  std::vector<ScheduledSample> samples;      // by due time; USBL fixes are due when the ship has them
  std::vector<ScheduledExposure> exposures;  // by time
  std::int64_t start_utc_ns = 0, end_utc_ns = 0;
  double rate = 1;
  // Mission time (UTC of the log) of the first lap's first moment, so that times of a first lap can be taken
  // back: mission = mission_begin + (vehicle - start) * rate.
  std::int64_t mission_begin_utc_ns = 0;

  // Mission seconds since the first played moment, as fault scripts count them.
  [[nodiscard]] double missionSeconds(std::int64_t vehicle_utc_ns) const {
    return static_cast<double>(vehicle_utc_ns - start_utc_ns) * 1e-9 * rate;
  }
  [[nodiscard]] std::int64_t vehicleTime(double mission_s) const {
    return start_utc_ns + static_cast<std::int64_t>(mission_s / rate * 1e9);
  }
  [[nodiscard]] PlayedTimes playedTimes() const;
};

// Reads the mission and moves it. Throws InputError for a mission that cannot be read, that has no pictures
// (features/ only), or of which nothing is left in the time asked for.
[[nodiscard]] MissionSchedule makeSchedule(const std::filesystem::path& mission_folder,
                                           const ScheduleOptions& options);

}  // namespace fathom::sim
