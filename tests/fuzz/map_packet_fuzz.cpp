// Map packets and Draco meshes from anywhere. What decodes must be bounded and finite.
#include <cmath>
#include <cstdlib>

#include "telemetry/map/map_packet.hpp"
#include "telemetry/tiles/draco_mesh.hpp"

using namespace fathom::telemetry;

namespace {

void check(bool good) {
  if (!good) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::span<const std::uint8_t> bytes = std::span(data, size).subspan(1);
  if (data[0] % 4 == 0) {
    constexpr std::size_t kMaxVertices = 2000;
    const auto mesh = decodeDracoMesh(bytes, kMaxVertices);
    if (!mesh) return 0;
    for (const auto& v : mesh->vertices) check(v.allFinite());
    for (const auto& triangle : mesh->triangles)
      for (const std::uint32_t k : triangle) check(k < mesh->vertices.size());
    return 0;
  }
  static MapPacketDecoder decoder;
  static DecodedMapPacket packet;
  if (!decoder.decode(bytes, packet)) return 0;
  check(!packet.blocks.empty() && packet.blocks.size() <= kMaxPacketBlocks && spacingOf(packet.spacing) > 0 &&
        packet.max_error > 0);
  for (const MapBlock& block : packet.blocks) {
    check(block.key.spacing == packet.spacing && std::isfinite(block.sigma));
    for (const float depth : block.depth) check(std::isfinite(depth));
  }
  return 0;
}
