#include "firmware_if/recorder/recording_folder.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <exception>
#include <limits>
#include <set>
#include <vector>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/log_messages.hpp"
#include "realtime/base/files/descriptor.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kFirstPause_ns = kSecond_ns, kLongestPause_ns = 30 * kSecond_ns;

void syncFile(const std::filesystem::path& path) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.open()) (void)::fsync(file.get());
}

// The disk must hold the mission's files and their names before its data. Other files that wait for the disk
// are not synced: after a crash they may be many.
void syncMission(const MissionPaths& paths) {
  for (const auto& path : {paths.root / "mission.toml", paths.calib(), paths.images(), paths.root,
                           std::filesystem::absolute(paths.root).parent_path()})
    syncFile(path);
}

// Names of the exposures in the newest part of the log, and the time of the first of them.
struct NamedImages {
  std::set<std::string> names;
  std::int64_t since_utc_ns = std::numeric_limits<std::int64_t>::min();
};

NamedImages newestNamed(const std::filesystem::path& log) {
  constexpr std::uint64_t kNewest = std::uint64_t{1} << 20;  // a minute or more
  NamedImages named;
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(log, error);
  if (error || size == 0) return named;
  const std::uint64_t from = size > kNewest ? size - kNewest : 0;
  LogEventReader events(log, from);
  LogEvent event;
  while (events.next(event)) {
    if (event.channel != "FATHOM_IMAGE") continue;
    const auto sample = decodeSample(event.channel, event.data);
    if (!sample) continue;
    const auto& image = std::get<ImageEvent>(sample->sample);
    if (named.names.empty() && from > 0) named.since_utc_ns = image.utc_ns;
    named.names.insert(image.file_name);
  }
  events.throwIfReadFailed();
  return named;
}

}  // namespace

FoundImages findImages(const MissionPaths& paths) {
  FoundImages found;
  const NamedImages named = newestNamed(paths.log());
  std::vector<std::filesystem::path> halves;
  for (const auto& file : std::filesystem::directory_iterator(paths.images())) {
    const std::string name = file.path().filename();
    if (name.ends_with(".tif.tmp")) halves.push_back(file.path());
    const auto image = parseImageFileName(name);
    if (image && image->utc_ns >= named.since_utc_ns && !named.names.contains(name)) ++found.without_event;
  }
  for (const auto& half : halves) {
    std::error_code error;
    if (std::filesystem::remove(half, error)) ++found.halves_removed;
  }
  return found;
}

RecordingFolder::RecordingFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                 const StereoRig& rig, const RecorderConfig& config)
    : paths_(folder), mission_(mission), rig_(rig), config_(config) {}

bool RecordingFolder::open(std::int64_t now_ns) {
  if (isOpen() || now_ns < next_try_ns_) return isOpen();
  pause_ns_ = std::clamp(2 * pause_ns_, kFirstPause_ns, kLongestPause_ns);
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
  if (!log_.open(paths_.log(), room, static_cast<std::uint64_t>(config_.log_reserve_mib * kMebibyte))) {
    failure_ = paths_.log().filename().string() + ": " + log_.failure();
    return false;
  }
  try {
    found_ = findImages(paths_);
    syncMission(paths_);
  } catch (const std::exception&) {
    // The images of an earlier run are left as they are; the log is what counts.
  }
  return true;
}

}  // namespace fathom::io
