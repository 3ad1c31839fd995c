#include "telemetry/monitor/codec/codec_report.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <map>
#include <stdexcept>

#include "realtime/base/units.hpp"
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

}  // namespace fathom::monitor
