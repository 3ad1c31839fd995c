#include "firmware_if/mission/sensor_log.hpp"

#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/log_messages.hpp"
#include "firmware_if/mission/log/raw_auv.hpp"
#include "firmware_if/mission/mission.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

std::int64_t eventTime(std::int64_t arrival_utc_ns) {
  return arrival_utc_ns / kMicrosecond_ns;
}

}  // namespace

struct SensorLogWriter::Impl {
  LogEventWriter events;
  std::string vehicle_name;
};

SensorLogWriter::SensorLogWriter(const std::filesystem::path& path, std::string vehicle_name)
    : impl_(new Impl{LogEventWriter(path), std::move(vehicle_name)}) {}

SensorLogWriter::~SensorLogWriter() = default;

void SensorLogWriter::write(std::int64_t arrival_utc_ns, const SensorSample& sample) {
  const LogMessage message = encodeSample(arrival_utc_ns, sample);
  impl_->events.write(eventTime(arrival_utc_ns), message.channel, message.data);
  if (impl_->vehicle_name.empty()) return;
  if (const auto twin = encodeAcfrTwin(sample, impl_->vehicle_name))
    impl_->events.write(eventTime(arrival_utc_ns), twin->channel, twin->data);
}

void SensorLogWriter::flush() {
  impl_->events.sync();
}

struct SensorLogReader::Impl {
  std::unique_ptr<LogEventReader> log;
  std::unique_ptr<RawAuvReader> text;
  ChannelKind kind = ChannelKind::kSample;  // which channels of the log are read
  std::uint64_t skipped = 0;
  std::uint64_t broken_messages = 0;

  void rewind() {
    if (log) log->rewind();
    if (text) text->rewind();
    skipped = broken_messages = 0;
  }

  std::optional<LoggedSample> next() {
    if (text) {
      auto sample = text->next();
      if (!sample) return std::nullopt;
      const std::int64_t utc_ns = std::visit([](const auto& s) { return s.utc_ns; }, *sample);
      return LoggedSample{utc_ns, std::move(*sample)};
    }
    LogEvent event;
    while (log->next(event)) {
      const ChannelKind found = channelKind(event.channel);
      if (found != kind) {
        // The ACFR twins of samples that are read are not counted.
        if (!(kind == ChannelKind::kSample && found == ChannelKind::kAcfr)) ++skipped;
        continue;
      }
      auto decoded = kind == ChannelKind::kSample ? decodeSample(event.channel, event.data)
                                                  : decodeAcfr(event.channel, event.timestamp_us, event.data);
      if (decoded) return LoggedSample{decoded->arrival_utc_ns, std::move(decoded->sample)};
      ++broken_messages;
    }
    log->throwIfReadFailed();
    return std::nullopt;
  }

  // Whether anything is there to read; begins again.
  bool holdsSample() {
    const bool any = next().has_value();
    rewind();
    return any;
  }
};

SensorLogReader::SensorLogReader(const std::filesystem::path& mission_folder) : impl_(new Impl) {
  const MissionPaths paths(mission_folder);
  if (std::filesystem::exists(paths.log())) {
    impl_->log = std::make_unique<LogEventReader>(paths.log());
    if (impl_->holdsSample()) return;
    impl_->kind = ChannelKind::kAcfr;
    if (impl_->holdsSample()) return;
    throw InputError(paths.log(), "", "holds no sample of navigation; give a log of this vehicle");
  }
  const auto raw_auv = paths.rawAuv();
  if (!raw_auv)
    throw InputError(mission_folder, "", "has neither sensors.lcmlog nor a *.RAW.auv; give a mission folder");
  // Of a folder that says nothing of itself, nav begins at 0 N 0 E.
  const bool described = std::filesystem::exists(mission_folder / "mission.toml");
  const MissionConfig mission = described ? readMissionConfig(mission_folder) : MissionConfig{};
  impl_->text = std::make_unique<RawAuvReader>(*raw_auv, mission.origin);
  if (!impl_->holdsSample()) throw InputError(*raw_auv, "", "holds no observation; give a RAW.auv");
}

SensorLogReader::~SensorLogReader() = default;

std::optional<LoggedSample> SensorLogReader::next() {
  return impl_->next();
}

std::uint64_t SensorLogReader::skippedEntries() const {
  return impl_->text ? impl_->text->skippedLines() : impl_->skipped;
}

std::uint64_t SensorLogReader::damagedEntries() const {
  return impl_->text ? impl_->text->damagedLines() : impl_->log->damagedStretches() + impl_->broken_messages;
}

}  // namespace fathom::io
