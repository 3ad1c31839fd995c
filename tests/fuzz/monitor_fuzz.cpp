// What a monitor shows after any row of frames: messages are wrapped in whole frames (a type byte and a
// length byte before each), so that the fuzzer need not find the CRC.
#include <array>

#include "telemetry/monitor/monitor_model.hpp"
#include "telemetry/monitor/reports.hpp"

using namespace fathom;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::span<const std::uint8_t> bytes(data, size);
  monitor::MonitorModel model;
  std::uint16_t sequence = 0;
  for (std::size_t at = 0; at + 2 <= size;) {
    const auto type = static_cast<telemetry::MessageType>(1 + data[at] % 6);
    const std::size_t length = std::min<std::size_t>(data[at + 1], size - at - 2);
    std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
    const std::size_t frame_size =
        telemetry::encodeFrame({{7, 42}, sequence++, type}, bytes.subspan(at + 2, length), frame);
    model.accept(std::span<const std::uint8_t>(frame).first(frame_size), sequence);
    at += 2 + length;
  }
  (void)monitor::stateJson(model, {});
  (void)monitor::trackJson(model);
  (void)monitor::tilesBinary(model, 0);
  (void)model.map().mesh();
  return 0;
}
