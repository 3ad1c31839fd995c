#include "firmware_if/log/input_tail.hpp"

#include <utility>

#include "firmware_if/files/mission.hpp"
#include "firmware_if/log/log_events.hpp"

namespace fathom::io {
namespace {

bool isCheckpoint(const OnboardInput& input, std::uint64_t number) {
  const auto* mark = std::get_if<Mark>(&input.what);
  return mark != nullptr && mark->kind == Mark::Kind::kCheckpoint && mark->number == number;
}

InputTail readFrom(const std::filesystem::path& log, std::uint64_t from, std::uint64_t number) {
  LogEventReader events(log, from);
  LogEvent event;
  InputTail tail;
  std::uint64_t damaged_messages = 0, damaged_before_mark = 0;
  while (events.next(event)) {
    if (!carriesInput(event.channel)) continue;
    auto input = decodeInput(event.channel, event.data);
    if (!input) {
      ++damaged_messages;
    } else if (number != 0 && isCheckpoint(*input, number)) {
      tail.mark_found = true;
      tail.inputs.clear();
      damaged_before_mark = damaged_messages + events.damagedStretches();
    } else {
      tail.inputs.push_back(std::move(*input));
    }
  }
  events.throwIfReadFailed();
  tail.damaged = damaged_messages + events.damagedStretches() - damaged_before_mark;
  return tail;
}

}  // namespace

InputTail readInputTail(const std::filesystem::path& mission_folder, std::uint64_t number,
                        std::int64_t mark_utc_ns) {
  constexpr std::uint64_t kFirstPiece = std::uint64_t{1} << 22;
  const std::filesystem::path log = MissionPaths(mission_folder).log();
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(log, error);
  for (std::uint64_t piece = kFirstPiece; number != 0 && piece < size; piece *= 4) {
    InputTail tail = readFrom(log, size - piece, number);
    const bool looked_at = !tail.inputs.empty() && tail.inputs.front().arrival_utc_ns < mark_utc_ns;
    if (tail.mark_found || looked_at) return tail;
  }
  return readFrom(log, 0, number);
}

}  // namespace fathom::io
