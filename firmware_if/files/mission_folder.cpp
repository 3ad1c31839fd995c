#include "firmware_if/files/mission_folder.hpp"

#include <system_error>

#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

void makeFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw InputError(folder, "", "cannot be made (" + error.message() + "); give another folder");
}

void removeRecording(const MissionPaths& paths) {
  std::filesystem::remove(paths.log());
  std::filesystem::remove_all(paths.images());
  while (const auto raw_auv = paths.rawAuv()) std::filesystem::remove(*raw_auv);
}

}  // namespace

MissionConfig prepareMissionFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                   const StereoRig& rig, bool replace) {
  const MissionPaths paths(folder);
  makeFolder(folder);
  const bool holds_mission = std::filesystem::exists(folder / "mission.toml");
  // Nothing is ever removed from, or mixed into, a folder that is no mission's.
  if (!holds_mission && !std::filesystem::is_empty(folder))
    throw InputError(folder, "", "is not empty and holds no mission.toml; give an empty folder or a mission");
  if (holds_mission && replace) removeRecording(paths);
  MissionConfig found = mission;
  if (holds_mission && !replace) {
    found = readMissionConfig(folder);
    if (found.vehicle_id != mission.vehicle_id || found.dive_id != mission.dive_id)
      throw InputError(folder, "mission.toml",
                       "is of vehicle " + std::to_string(found.vehicle_id) + ", dive " +
                           std::to_string(found.dive_id) + "; give each dive its own folder");
  } else {
    writeMissionConfig(folder, mission);
  }
  if (replace || !std::filesystem::exists(paths.calib())) writeStereoCalib(paths.calib(), rig);
  makeFolder(paths.images());
  return found;
}

}  // namespace fathom::io
