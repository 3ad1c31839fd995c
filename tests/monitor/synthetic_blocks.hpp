#pragma once

#include <cmath>
#include <vector>

#include "telemetry/map/map_block.hpp"

namespace fathom::monitor {

// A rough seafloor, smooth enough for centimetres between neighbouring nodes.
inline double syntheticDepth(double north, double east) {
  return 20 + 0.1 * north + 0.05 * east + 0.6 * std::sin(north * 0.7) * std::cos(east * 0.5);
}

inline telemetry::MapBlock syntheticBlock(telemetry::SpacingCode code, std::int32_t north, std::int32_t east,
                                          double shift = 0) {
  telemetry::MapBlock block;
  block.key = {code, north, east};
  block.seen = 0xFFFF;
  block.sigma = 0.02F;
  const double spacing = telemetry::spacingOf(code);
  for (int i = 0; i < telemetry::MapBlock::kSide; ++i) {
    for (int j = 0; j < telemetry::MapBlock::kSide; ++j) {
      const auto n = static_cast<std::size_t>(i * telemetry::MapBlock::kSide + j);
      const double at_north = (4.0 * north + i) * spacing, at_east = (4.0 * east + j) * spacing;
      block.depth[n] = static_cast<float>(syntheticDepth(at_north, at_east) + shift);
      block.colour[n] = {static_cast<std::uint8_t>(100 + 10 * i), static_cast<std::uint8_t>(50 + 10 * j), 40};
    }
  }
  return block;
}

inline constexpr telemetry::SpacingCode kQuarterMetre = 5, kHalfMetre = 6, kMetre = 7;

}  // namespace fathom::monitor
