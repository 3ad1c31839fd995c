#include <benchmark/benchmark.h>
#include <cmath>
#include <random>

#include "telemetry/map/map_packet.hpp"
#include "telemetry/monitor/codec/peers/lattice.hpp"
#include "telemetry/wire/frame.hpp"

namespace {

using namespace fathom;
using namespace fathom::telemetry;

// Time that map packets take, beside Draco on the same squares in the same run. Counters: bytes a packet (or
// a tile, frame included), blocks a packet, and of Draco peer_bytes and peer_ms.

constexpr double kError = 0.05;  // [m]

// Rubble on dunes at 25 cm, rows x cols nodes from a block's corner.
peers::Lattice ground(int rows, int cols) {
  peers::Lattice out{rows, cols, 0.25, {}};
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.03);
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < cols; ++j)
      out.depth.push_back(
          static_cast<float>(20 + 0.3 * std::sin(0.2 * i) * std::cos(0.17 * j) + noise(random)));
  return out;
}

std::vector<MapBlock> blocksOf(const peers::Lattice& lattice) {
  std::vector<MapBlock> out;
  for (int r = 0; r * 4 < lattice.rows; ++r) {
    for (int c = 0; c * 4 < lattice.cols; ++c) {
      MapBlock block{.key = {5, r, c}};
      for (int n = 0; n < MapBlock::kNodes; ++n) {
        const int i = r * 4 + n / 4, j = c * 4 + n % 4;
        if (i >= lattice.rows || j >= lattice.cols) continue;
        block.seen = static_cast<std::uint16_t>(block.seen | 1U << n);
        block.depth[static_cast<std::size_t>(n)] = lattice.depth[lattice.at(i, j)];
        block.colour[static_cast<std::size_t>(n)] = {60, static_cast<std::uint8_t>(80 + 5 * (i % 7)), 70};
      }
      out.push_back(block);
    }
  }
  return out;
}

// Arguments: frame [B], colour bits. The search for the most blocks that fit is part of it.
void packetEncode(benchmark::State& state) {
  const auto blocks = blocksOf(ground(64, 64));
  MapPacketEncoder encoder;
  std::vector<std::uint8_t> out(static_cast<std::size_t>(state.range(0)) - kFrameOverhead);
  const MapPacketConfig config{.max_error = kError, .colour_bits = static_cast<int>(state.range(1))};
  MapPacketEncoder::Result result;
  for (auto _ : state) benchmark::DoNotOptimize(result = encoder.encode(blocks, config, out));
  state.counters["bytes"] = static_cast<double>(result.bytes);
  state.counters["blocks"] = static_cast<double>(result.blocks);
}
BENCHMARK(packetEncode)
    ->ArgNames({"frame", "colour"})
    ->ArgsProduct({{256, 128, 64, 32}, {0, 3}})
    ->Unit(benchmark::kMillisecond);

void packetDecode(benchmark::State& state) {
  const auto blocks = blocksOf(ground(64, 64));
  MapPacketEncoder encoder;
  std::vector<std::uint8_t> out(static_cast<std::size_t>(state.range(0)) - kFrameOverhead);
  const auto result = encoder.encode(blocks, {.max_error = kError, .colour_bits = 0}, out);
  MapPacketDecoder decoder;
  DecodedMapPacket packet;
  for (auto _ : state) benchmark::DoNotOptimize(decoder.decode(std::span(out).first(result.bytes), packet));
}
BENCHMARK(packetDecode)->ArgName("frame")->Arg(256)->Arg(32)->Unit(benchmark::kMillisecond);

// A tile of side x side nodes by itself, and Draco on it.
void packetTile(benchmark::State& state) {
  const peers::Lattice lattice = ground(static_cast<int>(state.range(0)), static_cast<int>(state.range(0)));
  const auto blocks = blocksOf(lattice);
  MapPacketEncoder encoder;
  std::vector<std::uint8_t> out(kMaxFrameBytes - kFrameOverhead);
  MapPacketEncoder::Result result;
  for (auto _ : state)
    benchmark::DoNotOptimize(result = encoder.encode(blocks, {.max_error = kError, .colour_bits = 0}, out));
  const auto grid = peers::dracoGrid(lattice, kError), whole = peers::dracoWholeNumbers(lattice, kError);
  const peers::PeerResult& peer = grid.bytes < whole.bytes ? grid : whole;
  state.counters["bytes"] = static_cast<double>(result.bytes + kFrameOverhead);
  state.counters["peer_bytes"] = static_cast<double>(peer.bytes);
  state.counters["peer_ms"] = peer.encode_ms;
}
BENCHMARK(packetTile)->ArgName("side")->Arg(9)->Arg(17)->Unit(benchmark::kMillisecond);

}  // namespace
