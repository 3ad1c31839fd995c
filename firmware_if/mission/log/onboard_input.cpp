#include "firmware_if/mission/log/onboard_input.hpp"

#include <algorithm>
#include <fathom/decision_t.hpp>
#include <fathom/gap_t.hpp>
#include <fathom/mark_t.hpp>
#include <fathom/raw_t.hpp>
#include <fathom/tick_t.hpp>
#include <system_error>

#include "firmware_if/mission/log/checked_message.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
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

constexpr std::size_t kGapTextAt = 8 + 8 + 1 + 8, kGapRest = 4;  // [bytes] in a gap_t
constexpr std::string_view kModemIn = "FATHOM_MODEM_IN", kTick = "FATHOM_TICK", kDecision = kDecisionChannel,
                           kMark = kMarkChannel;

struct Encoder {
  std::int64_t arrival_utc_ns;

  LogMessage operator()(const SensorSample& sample) const { return encodeSample(arrival_utc_ns, sample); }
  LogMessage operator()(const ModemFrame& frame) const {
    return {std::string(kModemIn), encodeRaw(arrival_utc_ns, frame.data())};
  }
  LogMessage operator()(const Tick&) const {
    fathom::tick_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    return {std::string(kTick), encodeChecked(m)};
  }
  LogMessage operator()(const Decision& d) const {
    fathom::decision_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.pair_index = static_cast<std::int32_t>(d.pair_index);
    m.level = static_cast<std::int8_t>(d.level);
    m.dropped = d.dropped ? 1 : 0;
    return {std::string(kDecision), encodeChecked(m)};
  }
  LogMessage operator()(const Mark& mark) const {
    fathom::mark_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.kind = static_cast<std::int8_t>(mark.kind);
    m.number = static_cast<std::int64_t>(mark.number);
    return {std::string(kMark), encodeChecked(m)};
  }
};

std::optional<OnboardInput> decodeModemFrame(std::span<const std::uint8_t> data) {
  const auto raw = decodeRaw(data);
  ModemFrame frame;
  if (!raw || raw->bytes.empty() || raw->bytes.size() > frame.bytes.size()) return std::nullopt;
  frame.size = static_cast<std::uint16_t>(raw->bytes.size());
  std::copy(raw->bytes.begin(), raw->bytes.end(), frame.bytes.begin());
  return OnboardInput{raw->arrival_utc_ns, frame};
}

std::optional<OnboardInput> decodeTick(std::span<const std::uint8_t> data) {
  fathom::tick_t m = {};
  if (!checkHolds(data) || !decodeWhole(data, m)) return std::nullopt;
  return OnboardInput{m.arrival_utc_ns, Tick{}};
}

std::optional<OnboardInput> decodeDecision(std::span<const std::uint8_t> data) {
  fathom::decision_t m = {};
  if (!checkHolds(data) || !decodeWhole(data, m)) return std::nullopt;
  return OnboardInput{m.arrival_utc_ns, Decision{static_cast<std::uint32_t>(m.pair_index),
                                                 static_cast<std::uint8_t>(m.level), m.dropped != 0}};
}

std::optional<OnboardInput> decodeMark(std::span<const std::uint8_t> data) {
  fathom::mark_t m = {};
  if (!checkHolds(data) || !decodeWhole(data, m)) return std::nullopt;
  if (m.kind < 0 || m.kind > static_cast<std::int8_t>(Mark::Kind::kSent)) return std::nullopt;
  return OnboardInput{m.arrival_utc_ns,
                      Mark{static_cast<Mark::Kind>(m.kind), static_cast<std::uint64_t>(m.number)}};
}

// Every input of a log that holds Fathom's own samples; empty for another log.
std::vector<OnboardInput> readOwnInputs(const std::filesystem::path& log, std::uint64_t& damaged) {
  LogEventReader events(log);
  LogEvent event;
  std::vector<OnboardInput> inputs;
  bool samples = false;
  while (events.next(event)) {
    if (!carriesInput(event.channel)) continue;
    const bool sample = channelKind(event.channel) == ChannelKind::kSample;
    auto input = decodeInput(event.channel, event.data);
    if (!input) {
      ++damaged;
      continue;
    }
    samples |= sample;
    inputs.push_back(*input);
  }
  events.throwIfReadFailed();
  damaged += events.damagedStretches();
  return samples ? inputs : std::vector<OnboardInput>();
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

bool carriesInput(std::string_view channel) {
  return channel == kModemIn || channel == kTick || channel == kDecision || channel == kMark ||
         channelKind(channel) == ChannelKind::kSample;
}

LogMessage encodeInput(const OnboardInput& input) {
  return std::visit(Encoder{input.arrival_utc_ns}, input.what);
}

std::optional<OnboardInput> decodeInput(std::string_view channel, std::span<const std::uint8_t> data) {
  if (channel == kModemIn) return decodeModemFrame(data);
  if (channel == kTick) return decodeTick(data);
  if (channel == kDecision) return decodeDecision(data);
  if (channel == kMark) return decodeMark(data);
  auto sample = decodeSample(channel, data);
  if (!sample) return std::nullopt;
  return OnboardInput{sample->arrival_utc_ns, sample->sample};
}

std::vector<OnboardInput> readOnboardInputs(const std::filesystem::path& mission_folder,
                                            std::uint64_t& damaged) {
  damaged = 0;
  const MissionPaths paths(mission_folder);
  if (std::filesystem::exists(paths.log())) {
    std::vector<OnboardInput> own = readOwnInputs(paths.log(), damaged);
    if (!own.empty()) return own;
  }
  SensorLogReader reader(mission_folder);
  std::vector<OnboardInput> inputs;
  while (auto sample = reader.next()) inputs.push_back({sample->arrival_utc_ns, sample->sample});
  damaged = reader.damagedEntries();
  return inputs;
}

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
  if (!checkHolds(data) || !lengthFits(data, kGapTextAt, kGapRest) || !decodeWhole(data, m))
    return std::nullopt;
  if (m.kind < 0 || m.kind > static_cast<std::int8_t>(RecordingGap::Kind::kInputs) || m.count < 0)
    return std::nullopt;
  return RecordingGap{m.arrival_utc_ns, static_cast<RecordingGap::Kind>(m.kind),
                      static_cast<std::uint64_t>(m.count), m.what};
}

}  // namespace fathom::io
