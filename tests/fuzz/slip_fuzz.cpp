#include <algorithm>

#include "firmware_if/devices/modem/modem_ports.hpp"

using namespace fathom;

// Any bytes on the line; and any bytes as a frame behind them, which must come back whole.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  io::SlipDecoder decoder;
  for (std::size_t i = 0; i < size; ++i)
    if (decoder.push(data[i]) && decoder.frame().size() > FramePort::kMaxFrameBytes) __builtin_trap();
  std::array<std::uint8_t, io::kMaxSlipBytes> line;
  const std::span<const std::uint8_t> frame(data, std::min(size, FramePort::kMaxFrameBytes));
  const std::size_t n = io::slipEncode(frame, line);
  if (n == 0) return 0;
  bool found = false;
  for (std::size_t i = 0; i < n; ++i) found = decoder.push(line[i]);
  if (!found || !std::equal(frame.begin(), frame.end(), decoder.frame().begin(), decoder.frame().end()))
    __builtin_trap();
  return 0;
}
