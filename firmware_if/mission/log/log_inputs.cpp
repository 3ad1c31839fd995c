#include "firmware_if/mission/log/log_inputs.hpp"

#include <optional>
#include <system_error>

#include "firmware_if/mission/mission.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::io {
namespace {

bool isCheckpoint(const OnboardInput& input, std::uint64_t number) {
  const auto* mark = std::get_if<Mark>(&input.what);
  return mark != nullptr && mark->kind == Mark::Kind::kCheckpoint && mark->number == number;
}

struct MarkSearch {
  std::optional<std::uint64_t> behind;  // offset behind the newest such mark [bytes]
  std::optional<std::int64_t> oldest_utc_ns;
};

MarkSearch searchFrom(const std::filesystem::path& log, std::uint64_t from, std::uint64_t number) {
  LogEventReader events(log, from);
  LogEvent event;
  MarkSearch search;
  while (events.next(event)) {
    const bool mark = event.channel == kMarkChannel;
    if (!mark && (search.oldest_utc_ns || !carriesInput(event.channel))) continue;
    const auto input = decodeInput(event.channel, event.data);
    if (!input) continue;
    if (!search.oldest_utc_ns) search.oldest_utc_ns = input->arrival_utc_ns;
    if (isCheckpoint(*input, number)) search.behind = events.endOfLastEvent();
  }
  events.throwIfReadFailed();
  return search;
}

}  // namespace

LogInputReader::LogInputReader(const std::filesystem::path& mission_folder)
    : log_(MissionPaths(mission_folder).log()) {}

bool LogInputReader::seekBehindMark(std::uint64_t number, std::uint64_t position, std::int64_t mark_utc_ns) {
  constexpr std::uint64_t kFirstPiece = std::uint64_t{1} << 22;
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(log_, error);
  if (error == std::errc::no_such_file_or_directory || (!error && size == 0)) return false;
  if (error) throw InputError(log_, "", "cannot be read (" + error.message() + "); check the disk");
  for (std::uint64_t piece = kFirstPiece;; piece *= 4) {
    const std::uint64_t from = piece < size ? size - piece : 0;
    const MarkSearch search = searchFrom(log_, from, number);
    if (search.behind) {
      events_ = std::make_unique<LogEventReader>(log_, *search.behind, LogEventReader::Log::kGrows);
      position_ = position;
      damaged_entries_ = 0;
      return true;
    }
    if (from == 0 || (search.oldest_utc_ns && *search.oldest_utc_ns < mark_utc_ns)) return false;
  }
}

bool LogInputReader::open() {
  failure_.clear();
  if (events_) return true;
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(log_, error);
  if (error == std::errc::no_such_file_or_directory || (!error && size == 0)) return false;
  try {
    events_ = std::make_unique<LogEventReader>(log_, 0, LogEventReader::Log::kGrows);
  } catch (const InputError& e) {
    failure_ = e.what();
  }
  return events_ != nullptr;
}

LogInputReader::Step LogInputReader::next(Entry& entry) {
  if (!open()) return failure_.empty() ? Step::kEnd : Step::kUnreadable;
  LogEvent event;
  while (events_->next(event)) {
    const bool gap = event.channel == kGapChannel;
    if (!gap && !carriesInput(event.channel)) continue;
    const auto input = gap ? std::nullopt : decodeInput(event.channel, event.data);
    const auto left_out = gap ? decodeGap(event.data) : std::nullopt;
    if (!input && !left_out) {
      if (events_->readLastAgain()) continue;
      ++damaged_entries_;
      if (gap || event.channel == kDecisionChannel) continue;
      return missing(entry, 1);
    }
    if (left_out) {
      if (left_out->kind != RecordingGap::Kind::kInputs || !left_out->what.empty()) continue;
      return missing(entry, left_out->count);
    }
    entry.input = *input;
    entry.missing = 0;
    entry.position = position_;
    if (std::holds_alternative<Decision>(input->what)) return Step::kDecision;
    ++position_;
    return Step::kInput;
  }
  failure_ = events_->failure();
  return failure_.empty() ? Step::kEnd : Step::kUnreadable;
}

LogInputReader::Step LogInputReader::missing(Entry& entry, std::uint64_t count) {
  entry.position = position_;
  entry.missing = count;
  position_ += count;
  return Step::kMissing;
}

}  // namespace fathom::io
