#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "recon/geometry/height_tile.hpp"

namespace fathom::telemetry {

struct TileCodecConfig {
  double depth_resolution = 0.02;  // step of the sent depths, 0.001 to 1 [m]
  int colour_bits = 3;             // of brightness, one more of each chroma, 0 (no colour) to 6
  double min_coverage = 0.05;      // nodes seen less than this are not sent

  void validate() const;  // throws std::invalid_argument naming the value
};

inline constexpr std::size_t kMaxTileBytes = 4096;  // an encoded tile is never longer

inline constexpr int kMaxColourBits = 6;
inline constexpr unsigned kStrideBits = 2;  // of log2 of a stride
inline constexpr double kMaxTileSize_mm = 1048575;

// A tile as it arrives. Nodes that were not sent have coverage 0; sent ones 1, and the tile's median sigma.
struct DecodedTile {
  HeightTile tile;
  int stride = 1;               // nodes on multiples of stride only
  double depth_resolution = 0;  // [m]
  int colour_bits = 0;          // 0: no colours
};

// Encodes every stride-th node (1, 2, 4 or 8) of a tile. Lossless in the lattice (which nodes), depth rounded
// to the resolution, colour to the bits. Returns the size, 0 if the tile cannot be sent: no node seen, size
// not a whole number of millimetres up to kMaxTileSize_mm, depths too far apart, `out` too small.
[[nodiscard]] std::size_t encodeTile(const HeightTile& tile, int stride, const TileCodecConfig& config,
                                     std::span<std::uint8_t> out);

// Decodes bytes that may be anything; false if they are not a tile. Fills all of `out` but the tile's
// indices, level and revision (those travel with each fragment). Memory used is bounded by the lattice, not
// by the bytes.
[[nodiscard]] bool decodeTile(std::span<const std::uint8_t> bytes, DecodedTile& out);

}  // namespace fathom::telemetry
