// Bytes and time a map tile takes, against its peer: Draco's usual mesh coder (edgebreaker, whole numbers) on
// the same triangles. Counters: bytes (mean a tile), B_per_m2, peer_bytes, ratio (ours / peer).
#include <benchmark/benchmark.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/mesh.h>

#include <array>
#include <cmath>

#include "telemetry/tiles/tile_codec.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace {

using namespace fathom;
using namespace fathom::telemetry;

std::size_t peerBytes(const HeightTile& tile, int stride, const TileCodecConfig& config) {
  const int side = HeightTile::kCells / stride + 1;
  std::array<int, HeightTile::kNodes> id;
  id.fill(-1);
  int count = 0;
  for (int n = 0; n < side * side; ++n)
    if (tile.at(n / side * stride, n % side * stride).coverage > 0) id[static_cast<std::size_t>(n)] = count++;
  draco::Mesh mesh;
  const auto points = static_cast<std::uint32_t>(count);
  mesh.set_num_points(points);
  draco::GeometryAttribute position, colour;
  position.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_INT32, false, 12, 0);
  colour.Init(draco::GeometryAttribute::COLOR, nullptr, 3, draco::DT_UINT8, false, 3, 0);
  const int p = mesh.AddAttribute(position, true, points);
  const int c = config.colour_bits > 0 ? mesh.AddAttribute(colour, true, points) : -1;
  for (int n = 0; n < side * side; ++n) {
    const int k = id[static_cast<std::size_t>(n)];
    if (k < 0) continue;
    const HeightTile::Node& node = tile.at(n / side * stride, n % side * stride);
    const draco::AttributeValueIndex at(static_cast<std::uint32_t>(k));
    const std::array<std::int32_t, 3> xyz{
        n / side, n % side, static_cast<std::int32_t>(std::lround(node.depth / config.depth_resolution))};
    mesh.attribute(p)->SetAttributeValue(at, xyz.data());
    if (c < 0) continue;
    Rgb rgb = node.colour;
    for (auto& channel : rgb) channel = static_cast<std::uint8_t>(channel >> (8 - config.colour_bits));
    mesh.attribute(c)->SetAttributeValue(at, rgb.data());
  }
  const auto face = [&](int a, int b, int d) {
    if (a < 0 || b < 0 || d < 0) return;
    draco::Mesh::Face f;
    f[0] = static_cast<std::uint32_t>(a);
    f[1] = static_cast<std::uint32_t>(b);
    f[2] = static_cast<std::uint32_t>(d);
    mesh.AddFace(f);
  };
  for (int i = 0; i + 1 < side; ++i) {
    for (int j = 0; j + 1 < side; ++j) {
      const auto at = [&](int di, int dj) { return id[static_cast<std::size_t>((i + di) * side + j + dj)]; };
      face(at(0, 0), at(0, 1), at(1, 1));
      face(at(0, 0), at(1, 1), at(1, 0));
    }
  }
  draco::ExpertEncoder encoder(mesh);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(0, 0);
  draco::EncoderBuffer buffer;
  return encoder.EncodeToBuffer(&buffer).ok() ? buffer.size() : 0;
}

// Arguments: stride, colour bits, share of the tile with data [%].
void tileEncode(benchmark::State& state) {
  constexpr int kTiles = 40;
  const int stride = static_cast<int>(state.range(0));
  TileCodecConfig config;
  config.colour_bits = static_cast<int>(state.range(1));
  std::vector<HeightTile> tiles;
  double area = 0;
  for (int n = 0; n < kTiles; ++n) {
    tiles.push_back(sampleTile(n, 2 * n, 4.0, static_cast<double>(state.range(2)) / 100));
    for (const auto& node : tiles.back().nodes) area += node.coverage > 0 ? 16.0 / HeightTile::kNodes : 0;
  }
  std::array<std::uint8_t, kMaxTileBytes> out;
  double bytes = 0, peer = 0;
  for (const HeightTile& tile : tiles) {
    bytes += static_cast<double>(encodeTile(tile, stride, config, out));
    peer += static_cast<double>(peerBytes(tile, stride, config));
  }
  std::size_t n = 0;
  for (auto _ : state) benchmark::DoNotOptimize(encodeTile(tiles[n++ % kTiles], stride, config, out));
  state.counters["bytes"] = bytes / kTiles;
  state.counters["B_per_m2"] = bytes / area;
  state.counters["peer_bytes"] = peer / kTiles;
  state.counters["ratio"] = bytes / peer;
}
BENCHMARK(tileEncode)->ArgNames({"stride", "colour", "seen"})->ArgsProduct({{1, 2, 4}, {0, 2, 3}, {100, 50}});

void tileDecode(benchmark::State& state) {
  std::array<std::uint8_t, kMaxTileBytes> bytes;
  const std::size_t size = encodeTile(sampleTile(1, 2), static_cast<int>(state.range(0)), {}, bytes);
  DecodedTile tile;
  for (auto _ : state)
    benchmark::DoNotOptimize(decodeTile(std::span<const std::uint8_t>(bytes).first(size), tile));
}
BENCHMARK(tileDecode)->ArgNames({"stride"})->Arg(1)->Arg(4);

}  // namespace
