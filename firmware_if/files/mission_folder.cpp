#include "firmware_if/files/mission_folder.hpp"

#include <cstdio>
#include <system_error>

#include "firmware_if/files/civil_time.hpp"
#include "firmware_if/files/sensor_log.hpp"
#include "firmware_if/log/raw_auv.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

void makeFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw InputError(folder, "", "cannot be made (" + error.message() + "); give another folder");
}

}  // namespace

MissionConfig prepareMissionFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                   const StereoRig& rig) {
  const MissionPaths paths(folder);
  makeFolder(folder);
  const bool holds_mission = std::filesystem::exists(folder / "mission.toml");
  // Nothing is ever removed from, or mixed into, a folder that is no mission's.
  if (!holds_mission && !std::filesystem::is_empty(folder))
    throw InputError(folder, "", "is not empty and holds no mission.toml; give an empty folder or a mission");
  MissionConfig found = mission;
  if (holds_mission) {
    found = readMissionConfig(folder);
    if (found.vehicle_id != mission.vehicle_id || found.dive_id != mission.dive_id)
      throw InputError(folder, "mission.toml",
                       "is of vehicle " + std::to_string(found.vehicle_id) + ", dive " +
                           std::to_string(found.dive_id) + "; give each dive its own folder");
  } else {
    writeMissionConfig(folder, mission);
  }
  if (!std::filesystem::exists(paths.calib())) writeStereoCalib(paths.calib(), rig);
  makeFolder(paths.images());
  return found;
}

void deriveRawAuv(const std::filesystem::path& folder) {
  const MissionConfig mission = readMissionConfig(folder);
  const CivilTime start = civilFromUtc(mission.start_utc_ns);
  char time[80];
  std::snprintf(time, sizeof time, "%04d%02d%02d_%02d%02d%02d", start.year, start.month, start.day,
                start.hour, start.minute, start.second);
  SensorLogReader log(folder);
  RawAuvWriter text(folder / (mission.vehicle_name + "_" + time + ".RAW.auv"), mission.origin,
                    mission.magnetic_declination);
  while (const auto entry = log.next()) text.write(entry->sample);
  text.commit();
}

}  // namespace fathom::io
