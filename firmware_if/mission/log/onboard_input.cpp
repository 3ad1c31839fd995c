#include "firmware_if/mission/log/onboard_input.hpp"

#include <algorithm>
#include <fathom/decision_t.hpp>
#include <fathom/gap_t.hpp>
#include <fathom/mark_t.hpp>
#include <fathom/raw_t.hpp>
#include <fathom/tick_t.hpp>

#include "firmware_if/mission/log/checked_message.hpp"
#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"

namespace fathom::io {
namespace {

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
