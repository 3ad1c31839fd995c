// Frames of every decoded PGN in any order, with any bytes and times: every value that comes out is a number,
// and no frame is counted more than twice (as the end of one packet and as broken itself).
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "firmware_if/devices/can/n2k_decoder.hpp"
#include "firmware_if/devices/can/n2k_definitions.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace fathom::io;
  // Few slots, so that they run out.
  N2kDecoder decoder({.slots = 4, .timeout_ns = 750'000'000});
  std::uint64_t frames = 0;
  std::int64_t utc_ns = 0;
  // Eleven bytes a frame: which PGN, source and size, time step, data.
  for (; size >= 11; data += 11, size -= 11) {
    CanFrame frame;
    const N2kPgnSpec& spec = n2kPgns()[data[0] % n2kPgns().size()];
    frame.id = (spec.pgn << 8) | (data[1] & 3);
    frame.size = static_cast<std::uint8_t>(std::min(data[1] >> 2, 8));
    utc_ns += data[2] * std::int64_t{10'000'000};
    if (data[2] != 255) frame.utc_ns = utc_ns;
    std::copy_n(data + 3, 8, frame.data.begin());
    ++frames;
    if (const N2kMessage* message = decoder.add(frame)) {
      for (const N2kField& field : message->present()) {
        if (!std::isfinite(field.value)) std::abort();
      }
    }
  }
  decoder.finish();
  const FastPacketAssembler::Counts& counts = decoder.fastPacketCounts();
  if (counts.complete + counts.incomplete + counts.broken > 2 * frames) std::abort();
  return 0;
}
