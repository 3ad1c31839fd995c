// What a monitor shows after any row of frames: messages are wrapped in whole frames (a type byte and a
// length byte before each), so that the fuzzer need not find the CRC; all of them in bundles of the size that
// the first byte says.
#include <algorithm>

#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/map/received_map.hpp"
#include "telemetry/monitor/web/page_api.hpp"
#include "telemetry/wire/frame.hpp"

using namespace fathom;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::span<const std::uint8_t> bytes(data, size);
  monitor::SharedModel shared(std::nullopt, std::nullopt, 1);
  monitor::MonitorModel& model = *shared.model;
  std::uint16_t sequence = 0;
  std::array<std::uint8_t, telemetry::kMaxModemBytes> bundle;
  const std::size_t most = size == 0 ? 0 : std::size_t{data[0]} * 8;
  const bool padded = (most & 8U) != 0;
  const auto out = std::span<std::uint8_t>(bundle).first(most);
  telemetry::ModemFrameWriter modem(out, padded);
  const auto flush = [&] {
    if (const std::size_t used = modem.finish()) model.receive(out.first(used), sequence);
    modem = telemetry::ModemFrameWriter(out, padded);
  };
  for (std::size_t at = 0; at + 2 <= size;) {
    const auto type = static_cast<telemetry::MessageType>(1 + data[at] % 7);
    const std::size_t length = std::min<std::size_t>(data[at + 1], size - at - 2);
    std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
    const std::size_t frame_size =
        telemetry::encodeFrame({{7, 42}, sequence++, type, false}, bytes.subspan(at + 2, length), frame);
    const auto link_frame = std::span<const std::uint8_t>(frame).first(frame_size);
    if (modem.room().size() < frame_size) flush();
    if (modem.room().size() < frame_size || frame_size == 0) {
      model.receive(link_frame, sequence);
    } else {
      std::copy(link_frame.begin(), link_frame.end(), modem.room().begin());
      modem.add(frame_size);
    }
    at += 2 + length;
  }
  flush();
  model.receive(bytes, sequence);
  monitor::ModelView view;
  (void)monitor::stateJson(shared, view);
  (void)monitor::trackJson(view);
  (void)monitor::historyJson(model);
  (void)monitor::profileJson(view.surface(), -10, -10, 10, 10);
  (void)monitor::coverageBinary(view.coverage());
  (void)monitor::mapBinary(view.store(), view.surface(), 0, 0);
  (void)view.surface().whole();
  std::string why;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  (void)monitor::parseRequest(text, why);
  (void)monitor::parsePlayback(text, why);
  return 0;
}
