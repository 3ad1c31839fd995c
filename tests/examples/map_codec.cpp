// A square of the map of 4 x 4 m, 16 x 16 heights, as the bytes of one acoustic frame and back.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

#include "telemetry/map/map_packet.hpp"

int main() {
  using namespace fathom::telemetry;
  const SpacingCode spacing = *spacingCode(0.25);  // [m]
  std::vector<MapBlock> blocks;
  for (int north = 0; north < 4; ++north) {
    for (int east = 0; east < 4; ++east) {
      MapBlock block{.key = {spacing, north, east}, .seen = 0xFFFF, .sigma = 0.02F};
      for (int node = 0; node < MapBlock::kNodes; ++node) {
        const double x = 4 * north + node / MapBlock::kSide, y = 4 * east + node % MapBlock::kSide;
        block.depth[static_cast<std::size_t>(node)] =
            static_cast<float>(20 + 0.05 * x + 0.3 * std::sin(0.5 * y));
      }
      blocks.push_back(block);
    }
  }

  std::array<std::uint8_t, 256> frame{};
  MapPacketEncoder encoder;
  const MapPacketEncoder::Result sent = encoder.encode(blocks, {.max_error = 0.05}, frame);
  DecodedMapPacket received;
  MapPacketDecoder decoder;
  if (!decoder.decode({frame.data(), sent.bytes}, received)) return 1;

  double worst = 0;
  for (const MapBlock& block : received.blocks) {
    const auto original =
        std::find_if(blocks.begin(), blocks.end(), [&](const MapBlock& b) { return b.key == block.key; });
    for (std::size_t node = 0; node < block.depth.size(); ++node)
      worst = std::max(worst, std::abs(static_cast<double>(block.depth[node]) -
                                       static_cast<double>(original->depth[node])));
  }
  std::printf("bytes %zu blocks %zu worst %.4f\n", sent.bytes, received.blocks.size(), worst);
}
