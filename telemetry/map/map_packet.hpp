#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "telemetry/map/map_block.hpp"

namespace fathom::telemetry {

struct MapPacketConfig {
  double max_error =
      0.05;               // of every node's height, checked by decoding [m]; sent as a step of a fixed scale
  int colour_bits = 0;    // of brightness, 0 (no colour) to 6
  bool in_parts = false;  // a first block that does not fit by itself goes in part
};

// The number of this packet format; part of schemaHash(). Whatever changes a byte of a packet changes it.
inline constexpr std::uint16_t kMapPacketFormat = 1;
inline constexpr std::size_t kMaxPacketBlocks = 256;

// A decoded packet: blocks of one lattice.
struct DecodedMapPacket {
  SpacingCode spacing = 0;
  double max_error = 0;  // of the heights, as the sender bounded it [m]
  bool has_colour = false;
  std::vector<MapBlock> blocks;  // at most kMaxPacketBlocks; reserve once, reuse
};

// Encodes map blocks into the payload of one frame. Every packet is decoded by itself: it carries its place,
// spacing and error bound. No heap calls after construction.
class MapPacketEncoder {
 public:
  MapPacketEncoder();
  ~MapPacketEncoder();

  struct Result {
    std::size_t bytes = 0;   // of the payload; 0: not even the first block fits or can be sent
    std::size_t blocks = 0;  // the first so many of the blocks given are in the packet
  };
  // Encodes the longest prefix of `blocks` (one spacing, distinct keys, the most urgent first, near to each
  // other) that fits out.size(). `decoded`, unless empty, receives these blocks as the receiver will decode
  // them, in the same order. With in_parts a first block that does not fit by itself (a cliff in a small
  // frame) goes in part, coarsest nodes first: `blocks` is 1 and decoded[0].seen lacks nodes, to be sent as a
  // block with those alone seen. The receiver keeps the nodes that it has and the packet lacks.
  Result encode(std::span<const MapBlock> blocks, const MapPacketConfig& config, std::span<std::uint8_t> out,
                std::span<MapBlock> decoded = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Decodes bytes that may be anything; false if they are not a map packet. Work and memory are bounded.
class MapPacketDecoder {
 public:
  MapPacketDecoder();
  ~MapPacketDecoder();
  [[nodiscard]] bool decode(std::span<const std::uint8_t> payload, DecodedMapPacket& out);

  struct Impl;

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::telemetry
