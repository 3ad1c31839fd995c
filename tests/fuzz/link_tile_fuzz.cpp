// Encoded map tiles and their fragments. The bytes are taken as a tile, as Draco's values alone, and as a row
// of fragment payloads (a length byte before each).
#include <cmath>
#include <cstdlib>

#include "telemetry/tiles/tile_codec.hpp"

using namespace fathom::telemetry;

namespace {

void check(bool good) {
  if (!good) std::abort();
}

void checkTile(const DecodedTile& tile) {
  check(tile.tile.size > 0 && tile.depth_resolution > 0);
  for (const auto& node : tile.tile.nodes) check(std::isfinite(node.depth) && std::isfinite(node.sigma));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::span<const std::uint8_t> bytes(data, size);
  DecodedTile tile;
  if (decodeTile(bytes, tile)) checkTile(tile);
  if (size > 2) {
    std::array<std::int16_t, kMaxDracoComponents * kMaxDracoPoints> values;
    const int components = 1 + data[0] % kMaxDracoComponents;
    const std::size_t points = 1 + data[1] % kMaxDracoPoints;
    (void)decodeValues(bytes.subspan(2), components,
                       std::span(values).first(points * static_cast<std::size_t>(components)));
  }
  TileReassembler reassembler(4);
  for (std::size_t at = 0; at < size;) {
    const std::size_t length = std::min<std::size_t>(data[at], size - at - 1);
    if (reassembler.accept(bytes.subspan(at + 1, length), tile)) checkTile(tile);
    check(reassembler.open() <= 4);
    at += 1 + length;
  }
  return 0;
}
