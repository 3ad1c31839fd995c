#include "firmware_if/files/mission_folder.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <system_error>

#include "firmware_if/files/civil_time.hpp"
#include "firmware_if/files/sensor_log.hpp"
#include "firmware_if/log/raw_auv.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

// A path that can be no folder's is the operator's mistake; for all else the disk is to blame.
void makeFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (!error) return;
  for (const std::errc never : {std::errc::not_a_directory, std::errc::file_exists,
                                std::errc::filename_too_long, std::errc::too_many_symbolic_link_levels})
    if (error == never)
      throw InputError(folder, "", "cannot be made (" + error.message() + "); give another folder");
  throw std::system_error(error, folder.string() + ": cannot be made");
}

// A file that the disk does not give is not one that is wrong.
void requireReadable(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  char piece[4096];
  ssize_t n = fd < 0 ? -1 : 1;
  while (n > 0) n = ::read(fd, piece, sizeof piece);
  const int error = errno;
  const bool good = n == 0 || (fd >= 0 && error == EISDIR);
  if (fd >= 0) ::close(fd);
  if (!good) throw std::system_error(error, std::generic_category(), path.string() + ": cannot be read");
}

// Beside a half mission.toml, as a run leaves it that the disk refused.
bool holdsAnything(const std::filesystem::path& folder) {
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().filename() != "mission.toml.tmp") return true;
  return false;
}

}  // namespace

MissionConfig prepareMissionFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                   const StereoRig& rig) {
  const MissionPaths paths(folder);
  makeFolder(folder);
  const bool holds_mission = std::filesystem::exists(folder / "mission.toml");
  // Nothing is ever removed from, or mixed into, a folder that is no mission's.
  if (!holds_mission && holdsAnything(folder))
    throw InputError(folder, "", "is not empty and holds no mission.toml; give an empty folder or a mission");
  MissionConfig found = mission;
  if (holds_mission) {
    requireReadable(folder / "mission.toml");
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

bool deriveRawAuv(const std::filesystem::path& folder, const std::function<bool()>& go_on) {
  const MissionConfig mission = readMissionConfig(folder);
  const CivilTime start = civilFromUtc(mission.start_utc_ns);
  char time[80];
  std::snprintf(time, sizeof time, "%04d%02d%02d_%02d%02d%02d", start.year, start.month, start.day,
                start.hour, start.minute, start.second);
  SensorLogReader log(folder);
  RawAuvWriter text(folder / (mission.vehicle_name + "_" + time + ".RAW.auv"), mission.origin,
                    mission.magnetic_declination);
  constexpr int kSamplesBetweenLooks = 256;
  int count = 0;
  while (const auto entry = log.next()) {
    text.write(entry->sample);
    if (++count % kSamplesBetweenLooks == 0 && go_on && !go_on()) return false;
  }
  text.commit();
  return true;
}

}  // namespace fathom::io
