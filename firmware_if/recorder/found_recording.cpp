#include "firmware_if/recorder/found_recording.hpp"

#include <algorithm>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/log/log_events.hpp"
#include "firmware_if/log/log_messages.hpp"

namespace fathom::io {
namespace {

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

FoundImages lookAtImages(const MissionPaths& paths) {
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

}  // namespace fathom::io
