#pragma once

#include <array>
#include <cmath>
#include <compare>
#include <cstdint>
#include <optional>

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

}  // namespace fathom::telemetry
