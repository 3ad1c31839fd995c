#pragma once

#include <array>
#include <cmath>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::telemetry {

// The spacing of a lattice of height nodes, as one small number that every map packet carries. Codes 0 to 14
// are powers of two, 2^(code - 7) m: 7.8 mm to 128 m, 5 is 25 cm. Other spacings are whole millimetres: code
// = 15 + millimetres, up to 65.5 m.
using SpacingCode = std::uint16_t;
inline constexpr int kPowerCodes = 15;
inline constexpr int kUnitCode = 7;  // of 1 m

[[nodiscard]] inline double spacingOf(SpacingCode code) {
  return code < kPowerCodes ? std::ldexp(1.0, code - kUnitCode) : (code - kPowerCodes) * 1e-3;
}
// Nullopt for a spacing that no code has.
[[nodiscard]] inline std::optional<SpacingCode> spacingCode(double spacing) {
  for (SpacingCode code = 0; code < kPowerCodes; ++code)
    if (spacingOf(code) == spacing) return code;
  const double millimetres = std::round(spacing * 1e3);
  if (!(millimetres >= 1 && millimetres <= 65520) || std::abs(millimetres - spacing * 1e3) > 1e-6)
    return std::nullopt;
  return static_cast<SpacingCode>(kPowerCodes + static_cast<int>(millimetres));
}

// Identifies 4 x 4 nodes of a lattice. Node (i, j) of a block is in nav at north = (4 * north + i) * spacing,
// east = (4 * east + j) * spacing.
struct BlockKey {
  SpacingCode spacing = 0;
  std::int32_t north = 0, east = 0;
  friend auto operator<=>(const BlockKey&, const BlockKey&) = default;
};

// The smallest part of the map that the link sends, acknowledges and sends again. Unlike HeightTile, a block
// repeats no nodes of its neighbours.
struct MapBlock {
  static constexpr int kSide = 4;
  static constexpr int kNodes = kSide * kSide;
  static constexpr std::uint16_t kWhole = 0xFFFF;  // of `seen`: every node

  BlockKey key;
  std::uint16_t seen = 0;             // bit i * kSide + j: node (i, j) was seen
  float sigma = 0;                    // standard deviation of the heights, of the block [m]
  std::array<float, kNodes> depth{};  // nav z, down [m]; nothing where not seen
  std::array<Rgb, kNodes> colour{};   // valid when the packet or the source has colour

  [[nodiscard]] bool isSeen(int node) const { return (seen >> node & 1U) != 0; }
};

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
