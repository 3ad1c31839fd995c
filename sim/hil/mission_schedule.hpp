#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/hil/fault_script.hpp"

namespace fathom::sim {

struct ScheduleOptions {
  // Earliest vehicle time of the begin. It begins less than a second later, a whole number of seconds from
  // the mission's begin, so that the fractions of the stamps' seconds are kept.
  std::int64_t start_utc_ns = 0;
  double from_s = 0;   // begin after the mission's first sample [s]
  double seconds = 0;  // of the mission; 0: to its end
  double rate = 1;     // mission seconds for each second; scales velocities
  // The mission is played forward, then backward, and so on: on the return track images and attitude are the
  // same and velocities are inverted. So a short mission lasts as long as a bench run needs.
  int laps = 1;
  // Time at rest before and after the mission [s]: instruments continue with the first and last attitude and
  // depth and without velocity.
  double rest_before_s = 0, rest_after_s = 0;
};

// A sample in vehicle time, and when the device sends it.
struct ScheduledSample {
  std::int64_t due_utc_ns = 0;
  SensorSample sample;
};
struct ScheduledExposure {
  std::int64_t utc_ns = 0;  // of the exposure, by the mission's offsets
  CameraSide side = CameraSide::kLeft;
  std::string file_name;  // in the mission's img/
  double exposure_s = 0;
};

// A recorded or simulated mission shifted to the present, as what each device sends in vehicle time. The
// clock offsets in mission.toml are corrected, so that the vehicle's configuration has offsets of zero.
struct MissionSchedule {
  io::MissionConfig mission;  // for the vehicle: start, rate and clock offsets changed
  StereoRig rig;
  std::vector<ScheduledSample> samples;      // by due time; USBL fixes are due when the ship has them
  std::vector<ScheduledExposure> exposures;  // by time
  std::int64_t start_utc_ns = 0, end_utc_ns = 0;
  double rate = 1;
  // Mission time (UTC of the log) at the begin of the first lap: mission = mission_begin + (vehicle - start)
  // * rate.
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

// Reads a mission and shifts it. Throws InputError for a mission that cannot be read or has no pictures in
// the requested time.
[[nodiscard]] MissionSchedule makeSchedule(const std::filesystem::path& mission_folder,
                                           const ScheduleOptions& options);

}  // namespace fathom::sim
