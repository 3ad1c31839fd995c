#include "telemetry/monitor/codec/codec_program.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "realtime/base/command_line.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::monitor {
namespace {

using telemetry::MapBlock;

// Both ends of the link, with the figures of what crossed it.
class LinkPass {
 public:
  explicit LinkPass(const CodecSettings& settings)
      : settings_(settings), payload_(settings.frame - telemetry::kFrameOverhead) {}

  // Sends all the blocks.
  void send(std::vector<MapBlock> blocks) {
    for (std::size_t at = 0; at < blocks.size();) {
      const std::span<const MapBlock> left = std::span<const MapBlock>(blocks).subspan(at);
      const auto start = std::chrono::steady_clock::now();
      const auto result = encoder_.encode(
          left, {.max_error = settings_.max_error, .colour_bits = settings_.colour_bits, .in_parts = true},
          payload_, held_);
      const double ms = 1e3 * rt::secondsSince(start);
      if (result.blocks == 0) throw std::runtime_error("a map block could not be encoded");
      figures.encode_ms += ms;
      figures.slowest_ms = std::max(figures.slowest_ms, ms);
      receive(result.bytes, left.first(result.blocks));
      // A block too rough for one frame goes in parts.
      const auto rest = static_cast<std::uint16_t>(left[0].seen & ~held_[0].seen);
      if (result.blocks == 1 && rest != 0)
        blocks[at].seen = rest;
      else
        at += result.blocks;
    }
  }

  CodecFigures figures;
  double squares = 0;  // sum of squared errors

 private:
  void receive(std::size_t bytes, std::span<const MapBlock> sent) {
    std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
    const std::size_t size =
        telemetry::encodeFrame({{1, 1}, sequence_++, telemetry::MessageType::kMapPacket},
                               std::span(payload_).first(bytes), std::span(frame).first(settings_.frame));
    figures.bytes += size;
    ++figures.frames;
    const auto start = std::chrono::steady_clock::now();
    const auto arrived = telemetry::decodeFrame(std::span(frame).first(size));
    if (arrived.verdict != telemetry::FrameVerdict::kAccepted || !decoder_.decode(arrived.payload, packet_))
      throw std::runtime_error("a frame could not be decoded");
    figures.decode_ms += 1e3 * rt::secondsSince(start);
    std::map<telemetry::BlockKey, const MapBlock*> wanted;
    for (const MapBlock& block : sent) wanted[block.key] = &block;
    for (const MapBlock& got : packet_.blocks) {
      const auto block = wanted.find(got.key);
      if (block == wanted.end()) throw std::runtime_error("a frame gave a block that was not sent");
      for (int n = 0; n < MapBlock::kNodes; ++n) {
        if (!got.isSeen(n)) continue;
        const auto k = static_cast<std::size_t>(n);
        const double error =
            std::abs(static_cast<double>(got.depth[k]) - static_cast<double>(block->second->depth[k]));
        figures.max_error = std::max(figures.max_error, error);
        squares += error * error;
        ++figures.nodes;
      }
    }
  }

  CodecSettings settings_;
  telemetry::MapPacketEncoder encoder_;
  telemetry::MapPacketDecoder decoder_;
  telemetry::DecodedMapPacket packet_;
  std::vector<std::uint8_t> payload_;
  std::array<MapBlock, telemetry::kMaxPacketBlocks> held_;
  std::uint16_t sequence_ = 0;
};

constexpr double kLeastError = 0.001, kMostError = 0.9;  // that a map packet can say [m]
constexpr std::array<int, 2> kTileSides{9, 17};          // nodes

void check(const CodecOptions& options) {
  const std::string file = options.terrain.string();
  if (!telemetry::spacingCode(options.cell))
    throw InputError(file, "--cell", "must be a power of two metres or whole millimetres, 0.001 to 65.52 m");
  if (!(options.max_error >= kLeastError && options.max_error <= kMostError))
    throw InputError(file, "--max-error", "must be 0.001 to 0.9 m");
  if (options.frame < static_cast<long>(telemetry::kMinFrameBytes) ||
      options.frame > static_cast<long>(telemetry::kMaxFrameBytes))
    throw InputError(file, "--frame", "must be 32 to 256 bytes");
  if (options.colour_bits < 0 || options.colour_bits > 6)
    throw InputError(file, "--colour-bits", "must be 0 to 6");
  if (options.sampling != "map" && options.sampling != "point")
    throw InputError(file, "--sampling", "must be map or point");
}

void printTable(const CodecFigures& ours, const std::vector<TileFigures>& tiles,
                const std::vector<peers::PeerResult>& others, const CodecOptions& options) {
  std::printf("%zu nodes, %.1f m2, cells of %g m, error at most %g m, frames of at most %ld B\n", ours.nodes,
              ours.area, options.cell, options.max_error, options.frame);
  std::printf("%-28s %9s %8s %9s %8s %8s %9s\n", "", "bytes", "B/m2", "bit/node", "max [m]", "rms [m]",
              "enc [ms]");
  const auto row = [&](const std::string& name, std::size_t bytes, std::size_t nodes, double max, double rms,
                       double ms, const std::string& note) {
    std::printf("%-28s %9zu %8.3f %9.3f %8.4f %8.4f %9.2f  %s\n", name.c_str(), bytes,
                static_cast<double>(bytes) / ours.area,
                8.0 * static_cast<double>(bytes) / static_cast<double>(nodes), max, rms, ms, note.c_str());
  };
  row("map packets in frames", ours.bytes, ours.nodes, ours.max_error, ours.rms_error, ours.encode_ms,
      std::to_string(ours.frames) + " frames");
  for (const auto& peer : others) {
    if (peer.bytes == 0)
      std::printf("%-28s %9s\n", peer.name.c_str(), "no setting holds the error");
    else
      row(peer.name, peer.bytes, peer.nodes, peer.max_error, peer.rms_error, peer.encode_ms, peer.setting);
  }
  for (const TileFigures& t : tiles)
    std::printf("tiles of %d x %d nodes by themselves: %zu, mean %.1f B, at most %zu B, %zu in one frame\n",
                t.side, t.side, t.tiles, t.mean_bytes, t.max_bytes, t.in_one_frame);
}

void printJson(const CodecFigures& ours, const std::vector<TileFigures>& tiles,
               const std::vector<peers::PeerResult>& others, const CodecOptions& options) {
  nlohmann::ordered_json out{{"bytes", ours.bytes},
                             {"bytes_per_m2", ours.bytesPerArea()},
                             {"bits_per_vertex", ours.bitsPerNode()},
                             {"max_error_m", ours.max_error},
                             {"rms_error_m", ours.rms_error},
                             {"encode_ms", ours.encode_ms},
                             {"decode_ms", ours.decode_ms},
                             {"slowest_packet_ms", ours.slowest_ms},
                             {"frames", ours.frames},
                             {"frame_bytes", options.frame},
                             {"vertices", ours.nodes},
                             {"area_m2", ours.area},
                             {"cell_m", options.cell},
                             {"sampling", options.sampling},
                             {"colour_bits", options.colour_bits}};
  out["peers"] = nlohmann::ordered_json::array();
  for (const auto& peer : others) {
    nlohmann::ordered_json entry{{"name", peer.name}};
    if (peer.bytes == 0)
      entry["bytes"] = nullptr;
    else
      entry.update({{"bytes", peer.bytes},
                    {"max_error_m", peer.max_error},
                    {"rms_error_m", peer.rms_error},
                    {"bytes_per_m2", static_cast<double>(peer.bytes) / ours.area},
                    {"encode_ms", peer.encode_ms},
                    {"setting", peer.setting}});
    out["peers"].push_back(entry);
  }
  out["tiles"] = nlohmann::ordered_json::array();
  for (const TileFigures& t : tiles)
    out["tiles"].push_back({{"side", t.side},
                            {"tiles", t.tiles},
                            {"mean_bytes", t.mean_bytes},
                            {"max_bytes", t.max_bytes},
                            {"in_one_frame", t.in_one_frame}});
  std::printf("%s\n", out.dump().c_str());
}

}  // namespace

CodecFigures sendSurface(const LatticeSurface& surface, const CodecSettings& settings) {
  LinkPass link(settings);
  link.send(cutBlocks(surface));
  CodecFigures& figures = link.figures;
  if (figures.nodes != surface.seen) throw std::runtime_error("not every node came back");
  figures.area = surface.area();
  figures.rms_error = std::sqrt(link.squares / static_cast<double>(figures.nodes));
  return figures;
}

TileFigures sendTiles(const LatticeSurface& surface, int side, const CodecSettings& settings) {
  TileFigures out;
  out.side = side;
  std::size_t bytes = 0;
  // Tiles begin on any block.
  const auto first = [](int origin) {
    return ((-origin) % MapBlock::kSide + MapBlock::kSide) % MapBlock::kSide;
  };
  for (int row = first(surface.north0); row + side <= surface.rows; row += MapBlock::kSide) {
    for (int col = first(surface.east0); col + side <= surface.cols; col += MapBlock::kSide) {
      bool whole = true;
      for (int k = 0; k < side * side; ++k)
        whole = whole && !std::isnan(surface.depth[surface.at(row + k / side, col + k % side)]);
      if (!whole) continue;
      LinkPass link(settings);
      link.send(cutBlocks(surface, row, col, side, side));
      bytes += link.figures.bytes;
      out.max_bytes = std::max(out.max_bytes, link.figures.bytes);
      if (link.figures.frames == 1) ++out.in_one_frame;
      ++out.tiles;
    }
  }
  out.mean_bytes = out.tiles > 0 ? static_cast<double>(bytes) / static_cast<double>(out.tiles) : 0;
  return out;
}

peers::Lattice toLattice(const LatticeSurface& surface) {
  return {surface.rows, surface.cols, surface.cell, surface.depth};
}

int runCodec(const CodecOptions& options) {
  check(options);
  const LatticeSurface surface =
      sampleSurface(readPly(options.terrain), options.cell,
                    options.sampling == "point" ? Sampling::kPoint : Sampling::kMap, options.terrain);
  const CodecSettings settings{options.max_error, static_cast<std::size_t>(options.frame),
                               options.colour_bits};
  const CodecFigures ours = sendSurface(surface, settings);
  std::vector<TileFigures> tiles;
  for (const int side : kTileSides) tiles.push_back(sendTiles(surface, side, settings));
  const auto others = peers::allPeers(toLattice(surface), options.max_error);
  (options.json ? printJson : printTable)(ours, tiles, others, options);
  return kExitSuccess;
}

void addCodecCommand(CommandLine& app) {
  const auto options = std::make_shared<CodecOptions>();
  CommandLine& codec = app.command(
      "codec", "measures the map codec on a surface, beside Draco and JPEG 2000 held to the same error",
      "Example: fathom-monitor codec chamber3.ply --cell 0.25 --max-error 0.05",
      [options] { return runCodec(*options); });
  codec.add_option("terrain", options->terrain, "mesh (PLY): x north, y east, z down [m]")->required();
  codec.shown("--cell", options->cell, "spacing of the lattice [m]");
  codec.shown("--max-error", options->max_error, "largest error of a height [m]");
  codec.shown("--frame", options->frame, "largest frame [B], 32 to 256");
  codec.shown("--colour-bits", options->colour_bits,
              "send colour with so many bits of brightness (peers: heights only)");
  codec.shown("--sampling", options->sampling,
              "map: means under a tent one cell wide, as the onboard map gives them; point: the surface "
              "at the nodes");
  codec.add_flag("--json", options->json, "print one line of JSON");
}

}  // namespace fathom::monitor
