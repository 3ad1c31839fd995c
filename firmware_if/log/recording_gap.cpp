#include "firmware_if/log/recording_gap.hpp"

#include <fathom/gap_t.hpp>

#include "firmware_if/files/mission.hpp"
#include "firmware_if/log/checked_message.hpp"
#include "firmware_if/log/log_events.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kWhatAt = 8 + 8 + 1 + 8, kWhatRest = 4;

}  // namespace

LogMessage encodeGap(const RecordingGap& gap) {
  fathom::gap_t m = {};
  m.arrival_utc_ns = gap.arrival_utc_ns;
  m.kind = static_cast<std::int8_t>(gap.kind);
  m.count = static_cast<std::int64_t>(gap.count);
  m.what = gap.what;
  return {std::string(kGapChannel), encodeChecked(m)};
}

std::optional<RecordingGap> decodeGap(std::span<const std::uint8_t> data) {
  fathom::gap_t m = {};
  if (!checkHolds(data) || !lengthFits(data, kWhatAt, kWhatRest) || !decodeWhole(data, m))
    return std::nullopt;
  if (m.kind < 0 || m.kind > static_cast<std::int8_t>(RecordingGap::Kind::kInputs) || m.count < 0)
    return std::nullopt;
  return RecordingGap{m.arrival_utc_ns, static_cast<RecordingGap::Kind>(m.kind),
                      static_cast<std::uint64_t>(m.count), m.what};
}

RecordingGaps readGaps(const std::filesystem::path& mission_folder) {
  RecordingGaps gaps;
  const MissionPaths paths(mission_folder);
  if (!std::filesystem::exists(paths.log())) return gaps;
  LogEventReader log(paths.log());
  LogEvent event;
  while (log.next(event)) {
    if (event.channel != kGapChannel) continue;
    const auto gap = decodeGap(event.data);
    if (!gap) continue;
    if (gap->kind == RecordingGap::Kind::kImage) gaps.images += gap->count;
    if (gap->kind == RecordingGap::Kind::kRaw) gaps.raw_entries += gap->count;
    if (gap->kind == RecordingGap::Kind::kInputs) gaps.inputs += gap->count;
  }
  log.throwIfReadFailed();
  return gaps;
}

}  // namespace fathom::io
