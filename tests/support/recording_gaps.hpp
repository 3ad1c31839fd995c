#pragma once

#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/mission/mission.hpp"

namespace fathom::test {

// How much a mission's log says that it misses.
struct RecordingGaps {
  std::uint64_t images = 0, raw_entries = 0, inputs = 0;
};

// Zero where there is no log. Throws InputError for one that cannot be read.
inline RecordingGaps readGaps(const std::filesystem::path& mission_folder) {
  RecordingGaps gaps;
  const std::filesystem::path path = io::MissionPaths(mission_folder).log();
  if (!std::filesystem::exists(path)) return gaps;
  io::LogEventReader log(path);
  io::LogEvent event;
  while (log.next(event)) {
    if (event.channel != io::kGapChannel) continue;
    const auto gap = io::decodeGap(event.data);
    if (!gap) continue;
    std::uint64_t& sum = gap->kind == io::RecordingGap::Kind::kImage ? gaps.images
                         : gap->kind == io::RecordingGap::Kind::kRaw ? gaps.raw_entries
                                                                     : gaps.inputs;
    sum += gap->count;
  }
  log.throwIfReadFailed();
  return gaps;
}

}  // namespace fathom::test
