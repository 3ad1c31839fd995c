#include "firmware_if/devices/capture_commands.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cinttypes>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <vector>

#include "firmware_if/devices/can/can_text.hpp"
#include "firmware_if/devices/can/n2k_definitions.hpp"
#include "firmware_if/devices/can/raw_can.hpp"
#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"
#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/log_messages.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kReadBytes = 64 * 1024;

void finishOutput(std::FILE* out) {
  if (std::fflush(out) != 0 || std::ferror(out) != 0)
    throw std::runtime_error("the output could not be written");
}

// An absent value is an empty field. `decimals` is the resolution on the wire, so nothing is rounded away.
void field(std::FILE* out, const std::optional<double>& value, int decimals) {
  if (value) {
    std::fprintf(out, ",%.*f", decimals, *value);
  } else {
    std::fputc(',', out);
  }
}

// Velocities as sent: of the bottom relative to the instrument, in the axes that `frame` names.
void dvlCsvHeader(std::FILE* out) {
  std::fputs(
      "ensemble,utc_ns,frame,v1_mps,v2_mps,v3_mps,v4_mps,range1_m,range2_m,range3_m,range4_m,heading_deg,"
      "pitch_deg,roll_deg,sound_speed_mps\n",
      out);
}

void dvlCsvRow(std::FILE* out, const Pd0Ensemble& ensemble) {
  const Pd0BottomTrack track = ensemble.bottom_track.value_or(Pd0BottomTrack{});
  std::fprintf(out, "%" PRIu32 ",", ensemble.number);
  if (ensemble.utc_ns) std::fprintf(out, "%" PRId64, *ensemble.utc_ns);
  std::fprintf(out, ",%s", frameName(ensemble.frame));
  for (const auto& velocity : track.velocity) field(out, velocity, 3);
  for (const auto& range : track.range) field(out, range, 2);
  field(out, ensemble.heading_deg, 2);
  field(out, ensemble.pitch_deg, 2);
  field(out, ensemble.roll_deg, 2);
  field(out, ensemble.sound_speed, 0);
  std::fputc('\n', out);
}

// What an operator checks in a capture before using it.
class DvlSummary {
 public:
  void add(const Pd0Ensemble& ensemble) {
    if (ensembles_++ == 0) first_ = ensemble;
    last_ = ensemble;
    if (ensemble.hasBottomTrackVelocity()) ++with_velocity_;
    if (ensemble.up_looking) ++up_looking_;
    const auto sample = toDvlSample(ensemble);
    if (!sample) return;
    if (sample->altitude) altitude_.add(*sample->altitude);
    if (sample->velocity) speed_.add(sample->velocity->norm());
  }

  void print(std::FILE* out) const {
    std::fprintf(out, "ensembles            %" PRIu64 " (%" PRIu32 " to %" PRIu32 ")\n", ensembles_,
                 first_.number, last_.number);
    std::fprintf(out, "with bottom track    %" PRIu64 "\n", with_velocity_);
    if (first_.utc_ns && last_.utc_ns) {
      std::fprintf(out, "from, for            %.2f s UTC, %.2f s\n",
                   static_cast<double>(*first_.utc_ns) * 1e-9,
                   static_cast<double>(*last_.utc_ns - *first_.utc_ns) * 1e-9);
    }
    std::fprintf(out, "frame                %s%s\n", frameName(first_.frame),
                 first_.tilts_used ? " (tilts used)" : "");
    std::fprintf(out, "firmware, beams      %d.%d, %d beams\n", first_.firmware_version,
                 first_.firmware_revision, first_.beams);
    std::fprintf(out, "profile looks up     %" PRIu64 "\n", up_looking_);
    altitude_.print(out, "altitude [m]        ");
    speed_.print(out, "speed [m/s]         ");
  }

 private:
  struct Extent {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();
    void add(double value) {
      low = std::min(low, value);
      high = std::max(high, value);
    }
    void print(std::FILE* out, const char* label) const {
      if (low <= high) std::fprintf(out, "%s %.2f to %.2f\n", label, low, high);
    }
  };
  std::uint64_t ensembles_ = 0;
  std::uint64_t with_velocity_ = 0;
  std::uint64_t up_looking_ = 0;
  Pd0Ensemble first_;
  Pd0Ensemble last_;
  Extent altitude_;
  Extent speed_;
};

void appendJsonNumber(std::string& out, double value) {
  std::array<char, 32> digits{};
  const auto result = std::to_chars(digits.data(), digits.data() + digits.size(), value);
  out.append(digits.data(), result.ptr);
}

// Microseconds, the resolution of candump; nanoseconds where there are some.
void appendJsonSeconds(std::string& out, std::int64_t utc_ns) {
  std::array<char, 32> text{};
  const std::int64_t fraction = utc_ns % kSecond_ns;
  const bool micro = fraction % 1000 == 0;
  const int size = std::snprintf(text.data(), text.size(), "%" PRId64 ".%0*" PRId64, utc_ns / kSecond_ns,
                                 micro ? 6 : 9, micro ? fraction / 1000 : fraction);
  out.append(text.data(), static_cast<std::size_t>(size));
}

void printCanSummary(std::FILE* out, const std::map<std::uint32_t, std::uint64_t>& messages) {
  std::fprintf(out, "%8s %9s  what\n", "pgn", "messages");
  for (const auto& [pgn, count] : messages) {
    std::fprintf(out, "%8" PRIu32 " %9" PRIu64 "  %s\n", pgn, count, findN2kPgn(pgn)->description);
  }
}

struct CaptureCounts {
  std::uint64_t frames = 0;
  std::uint64_t packets = 0;  // N2K messages that the capture holds already assembled
  std::uint64_t other = 0;    // 11-bit, remote, error and CAN FD frames; in a log, error frames only
  std::uint64_t broken = 0;   // lines; in a log, undecodable entries and damaged stretches
};

template <class Take>
CaptureCounts readCanText(const std::filesystem::path& path, Take&& take) {
  ByteFile file(path);
  CanTextReader reader;
  std::vector<std::uint8_t> buffer(kReadBytes);
  while (const std::size_t got = file.read(buffer)) reader.feed({buffer.data(), got}, take, take);
  reader.drain(take, take);
  return {reader.counts().frames, reader.counts().packets, reader.counts().other, reader.counts().broken};
}

template <class Take>
CaptureCounts readCanLog(const std::filesystem::path& path, Take&& take) {
  LogEventReader log(path);
  CaptureCounts counts;
  for (LogEvent event; log.next(event);) {
    if (event.channel != "RAW_CAN") continue;
    auto raw = decodeRaw(event.data);
    RawCanRecord record;
    while (raw && readRawCan(raw->bytes, raw->arrival_utc_ns, record)) {
      ++(record.error ? counts.other : counts.frames);
      if (!record.error) take(record.frame);
    }
    counts.broken += raw && raw->bytes.empty() ? 0 : 1;
  }
  log.throwIfReadFailed();
  counts.broken += log.damagedStretches();
  return counts;
}

}  // namespace

std::string toJson(const N2kMessage& message) {
  std::string out = "{";
  if (message.utc_ns) {
    out += "\"time_s\":";
    appendJsonSeconds(out, *message.utc_ns);
    out += ",";
  }
  out += "\"pgn\":" + std::to_string(message.id.pgn) + ",\"source\":" + std::to_string(message.id.source) +
         ",\"fields\":{";
  const char* comma = "";
  for (const N2kField& field : message.present()) {
    out.append(comma).append("\"").append(field.name).append("\":");
    if (field.text != nullptr) {
      out.append("\"").append(field.text).append("\"");
    } else {
      appendJsonNumber(out, field.value);
    }
    comma = ",";
  }
  return out + "}}";
}

int runDvlCommand(const DvlCommand& command, std::FILE* out, std::FILE* report) {
  ByteFile file(command.file);
  Pd0Decoder decoder;
  DvlSummary summary;
  const auto take = [&](const Pd0Ensemble& ensemble) {
    summary.add(ensemble);
    if (!command.csv) return;
    if (decoder.counts().good == 1) dvlCsvHeader(out);
    dvlCsvRow(out, ensemble);
  };

  std::vector<std::uint8_t> buffer(kReadBytes);
  while (const std::size_t got = file.read(buffer)) decoder.feed({buffer.data(), got}, take);
  decoder.drain(take);

  const Pd0Decoder::Counts& counts = decoder.counts();
  if (counts.good == 0) {
    throw InputError(command.file.string(), "",
                     "holds no PD0 ensemble with a right checksum; give a binary RDI PD0 capture");
  }
  if (!command.csv) summary.print(out);
  finishOutput(out);
  std::fprintf(report,
               "good %" PRIu64 ", bad-checksum %" PRIu64 ", resynced %" PRIu64 ", malformed %" PRIu64
               ", truncated %" PRIu64 ", skipped %" PRIu64 " bytes\n",
               counts.good, counts.bad_checksum, counts.resynced, counts.malformed, counts.truncated,
               counts.skipped_bytes);
  return kExitSuccess;
}

int runCanCommand(const CanCommand& command, std::FILE* out, std::FILE* report) {
  N2kDecoder decoder;
  std::map<std::uint32_t, std::uint64_t> messages;
  const auto take = [&](const auto& part) {
    const N2kMessage* message = decoder.add(part);
    if (message == nullptr) return;
    ++messages[message->id.pgn];
    if (command.json) std::fprintf(out, "%s\n", toJson(*message).c_str());
  };
  const CaptureCounts counts = command.file.extension() == ".lcmlog" ? readCanLog(command.file, take)
                                                                     : readCanText(command.file, take);
  decoder.finish();

  if (counts.frames + counts.packets == 0) {
    throw InputError(
        command.file.string(), "",
        "holds no CAN frame with a 29-bit identifier; give a capture of candump, canboat, a Yacht Devices "
        "(RAW) or an Actisense (N2K ASCII) gateway, or a mission's sensors.lcmlog");
  }
  if (!command.json) printCanSummary(out, messages);
  finishOutput(out);
  const FastPacketAssembler::Counts& fast = decoder.fastPacketCounts();
  std::fprintf(report,
               "frames %" PRIu64 ", whole messages %" PRIu64 ", messages %" PRIu64
               ", without decoder %" PRIu64 ", other frames %" PRIu64 ", broken lines %" PRIu64
               ", fast packets: complete %" PRIu64 ", incomplete %" PRIu64 ", orphan frames %" PRIu64
               ", broken frames %" PRIu64 "\n",
               counts.frames, counts.packets, decoder.counts().messages, decoder.counts().without_decoder,
               counts.other, counts.broken, fast.complete, fast.incomplete, fast.orphans, fast.broken);
  return kExitSuccess;
}

}  // namespace fathom::io
