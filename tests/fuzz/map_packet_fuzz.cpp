// Map packets from anywhere. What decodes must be bounded and finite.
#include <cmath>
#include <cstdlib>

#include "telemetry/map/map_packet.hpp"

using namespace fathom::telemetry;

namespace {

void check(bool good) {
  if (!good) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static MapPacketDecoder decoder;
  static DecodedMapPacket packet;
  if (!decoder.decode(std::span(data, size), packet)) return 0;
  check(!packet.blocks.empty() && packet.blocks.size() <= kMaxPacketBlocks && spacingOf(packet.spacing) > 0 &&
        packet.max_error > 0);
  for (const MapBlock& block : packet.blocks) {
    check(block.key.spacing == packet.spacing && std::isfinite(block.sigma));
    for (const float depth : block.depth) check(std::isfinite(depth));
  }
  return 0;
}
