#include "firmware_if/can/can_command.hpp"

#include <array>
#include <charconv>
#include <cinttypes>
#include <map>
#include <stdexcept>
#include <vector>

#include "firmware_if/can/can_text.hpp"
#include "firmware_if/can/n2k_definitions.hpp"
#include "firmware_if/can/raw_can.hpp"
#include "firmware_if/files/byte_file.hpp"
#include "firmware_if/log/log_events.hpp"
#include "firmware_if/log/log_messages.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kReadBytes = 64 * 1024;

void appendNumber(std::string& out, double value) {
  std::array<char, 32> digits{};
  const auto result = std::to_chars(digits.data(), digits.data() + digits.size(), value);
  out.append(digits.data(), result.ptr);
}

// Microseconds, the resolution of candump; nanoseconds where there are some.
void appendSeconds(std::string& out, std::int64_t utc_ns) {
  std::array<char, 32> text{};
  const std::int64_t fraction = utc_ns % 1'000'000'000;
  const bool micro = fraction % 1000 == 0;
  const int size = std::snprintf(text.data(), text.size(), "%" PRId64 ".%0*" PRId64, utc_ns / 1'000'000'000,
                                 micro ? 6 : 9, micro ? fraction / 1000 : fraction);
  out.append(text.data(), static_cast<std::size_t>(size));
}

void printSummary(std::FILE* out, const std::map<std::uint32_t, std::uint64_t>& messages) {
  std::fprintf(out, "%8s %9s  what\n", "pgn", "messages");
  for (const auto& [pgn, count] : messages) {
    std::fprintf(out, "%8" PRIu32 " %9" PRIu64 "  %s\n", pgn, count, findN2kPgn(pgn)->description);
  }
}

}  // namespace

std::string toJson(const N2kMessage& message) {
  std::string out = "{";
  if (message.utc_ns) {
    out += "\"time_s\":";
    appendSeconds(out, *message.utc_ns);
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
      appendNumber(out, field.value);
    }
    comma = ",";
  }
  return out + "}}";
}

namespace {

struct CaptureCounts {
  std::uint64_t frames = 0;
  std::uint64_t packets = 0;  // whole messages
  std::uint64_t other =
      0;  // frames that are no 29-bit data frames: 11 bits, remote, of the controller's errors
  std::uint64_t broken = 0;  // lines or log entries
};

template <class Take>
CaptureCounts readText(const std::filesystem::path& path, Take&& take) {
  ByteFile file(path);
  CanTextReader reader;
  std::vector<std::uint8_t> buffer(kReadBytes);
  while (const std::size_t got = file.read(buffer)) reader.feed({buffer.data(), got}, take, take);
  reader.drain(take, take);
  return {reader.counts().frames, reader.counts().packets, reader.counts().other, reader.counts().broken};
}

template <class Take>
CaptureCounts readLog(const std::filesystem::path& path, Take&& take) {
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

int runCanCommand(const CanCommand& command, std::FILE* out, std::FILE* report) {
  N2kDecoder decoder;
  std::map<std::uint32_t, std::uint64_t> messages;
  const auto take = [&](const auto& part) {
    const N2kMessage* message = decoder.add(part);
    if (message == nullptr) return;
    ++messages[message->id.pgn];
    if (command.json) std::fprintf(out, "%s\n", toJson(*message).c_str());
  };
  const CaptureCounts counts =
      command.file.extension() == ".lcmlog" ? readLog(command.file, take) : readText(command.file, take);
  decoder.finish();

  if (counts.frames + counts.packets == 0) {
    throw InputError(
        command.file.string(), "",
        "holds no CAN frame with a 29-bit identifier; give a capture of candump, canboat, a Yacht Devices "
        "(RAW) or an Actisense (N2K ASCII) gateway, or a mission's sensors.lcmlog");
  }
  if (!command.json) printSummary(out, messages);
  if (std::fflush(out) != 0 || std::ferror(out) != 0)
    throw std::runtime_error("the output could not be written");
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
