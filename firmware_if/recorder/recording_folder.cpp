#include "firmware_if/recorder/recording_folder.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <exception>

#include "firmware_if/files/mission_folder.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kFirstPause = 1'000'000'000, kLongestPause = 30'000'000'000;  // [ns]

void syncFile(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return;
  (void)::fsync(fd);
  ::close(fd);
}

// The disk must hold the mission's files, and their names, before it holds its data. Not all that waits for
// the disk: after a crash that may be much, and has time.
void syncMission(const MissionPaths& paths) {
  for (const auto& path : {paths.root / "mission.toml", paths.calib(), paths.images(), paths.root,
                           std::filesystem::absolute(paths.root).parent_path()})
    syncFile(path);
}

std::uint64_t mebibytes(double mib) {
  return static_cast<std::uint64_t>(mib * 1024.0 * 1024.0);
}

}  // namespace

RecordingFolder::RecordingFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                 const StereoRig& rig, const RecorderConfig& config)
    : paths_(folder), mission_(mission), rig_(rig), config_(config) {}

bool RecordingFolder::open(std::int64_t now_ns) {
  if (isOpen() || now_ns < next_try_ns_) return isOpen();
  pause_ns_ = std::clamp(2 * pause_ns_, kFirstPause, kLongestPause);
  next_try_ns_ = now_ns + pause_ns_;
  ++refusals_;
  try {
    if (!openAll()) return false;
  } catch (const InputError& e) {
    failure_ = e.what();
    throw;
  } catch (const std::exception& e) {
    failure_ = e.what();
    return false;
  }
  --refusals_;
  return true;
}

bool RecordingFolder::openAll() {
  mission_ = prepareMissionFolder(paths_.root, mission_, rig_);
  const std::uint64_t room = plannedBytes(config_, mission_, rig_).log;
  if (!log_.open(paths_.log(), room, mebibytes(config_.log_reserve_mib))) {
    failure_ = paths_.log().filename().string() + ": " + log_.failure();
    return false;
  }
  try {
    found_ = lookAtImages(paths_);
    syncMission(paths_);
  } catch (const std::exception&) {
    // The images of an earlier run are left as they are; the log is what counts.
  }
  return true;
}

}  // namespace fathom::io
