// Any text, cut anywhere, must read the same as in one piece; what it decodes to must print.
#include <cstdlib>

#include "firmware_if/devices/can/can_text.hpp"
#include "firmware_if/devices/can/n2k_decoder.hpp"
#include "firmware_if/devices/capture_commands.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace fathom::io;
  const std::span<const std::uint8_t> bytes(data, size);
  N2kDecoder decoder;
  const auto decode = [&](const auto& part) {
    if (const N2kMessage* message = decoder.add(part)) (void)toJson(*message);
  };

  CanTextReader whole;
  whole.feed(bytes, decode, decode);
  whole.drain(decode, decode);
  decoder.finish();

  CanTextReader cut;
  const std::size_t at = size == 0 ? 0 : data[0] * size / 256;
  cut.feed(bytes.first(at), [](const CanFrame&) {});
  cut.feed(bytes.subspan(at), [](const CanFrame&) {});
  cut.drain([](const CanFrame&) {});
  if (whole.counts().frames != cut.counts().frames || whole.counts().packets != cut.counts().packets ||
      whole.counts().broken != cut.counts().broken)
    std::abort();
  return 0;
}
