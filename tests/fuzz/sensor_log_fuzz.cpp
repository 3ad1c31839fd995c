#include "firmware_if/mission/sensor_log.hpp"

#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/log_messages.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"
#include "tests/fuzz/scratch_file.hpp"

using namespace fathom;

// Any bytes as sensors.lcmlog, through the reader; and each message of the framing through every decoder, so
// that the decoders are reached without a right CRC.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFile file("sensors.lcmlog");
  file.write(data, size);
  fuzz::readsOrRefuses([] {
    io::SensorLogReader reader(file.folder());
    while (reader.next()) continue;
  });
  fuzz::readsOrRefuses([size] {
    io::LogEventReader events(file.path());
    io::LogEvent event;
    std::size_t bytes = 0;
    while (events.next(event)) {
      bytes += event.data.size() + event.channel.size();
      if (bytes > size || events.endOfLastEvent() > size) __builtin_trap();
      static_cast<void>(io::decodeSample(event.channel, event.data));
      static_cast<void>(io::decodeAcfr(event.channel, event.timestamp_us, event.data));
      static_cast<void>(io::decodeRaw(event.data));
      static_cast<void>(io::decodeInput(event.channel, event.data));
      static_cast<void>(io::decodeGap(event.data));
    }
    if (events.endOfLastEvent() != io::findLogEnd(file.path()).offset) __builtin_trap();
  });
  fuzz::readsOrRefuses([size] {
    io::LogInputReader inputs(file.folder());
    io::LogInputReader::Entry entry;
    std::size_t steps = 0;
    while (inputs.next(entry) != io::LogInputReader::Step::kEnd)
      if (++steps > size) __builtin_trap();
    if (inputs.next(entry) != io::LogInputReader::Step::kEnd) __builtin_trap();
    static_cast<void>(inputs.seekBehindMark(1, 0));
  });
  return 0;
}
