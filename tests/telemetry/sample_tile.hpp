#pragma once

#include <algorithm>
#include <cmath>
#include <random>

#include "recon/geometry/height_tile.hpp"

namespace fathom::telemetry {

// Rubbly seafloor around 20 m, ripples and boulders, 1 cm of noise; every tile is its own (by key and seed),
// heights are continuous over tile borders apart from the noise. `seen`: share of the tile that is covered.
inline HeightTile sampleTile(std::int32_t north, std::int32_t east, double size = 4.0, double seen = 1.0,
                             unsigned seed = 1, std::uint32_t revision = 1) {
  HeightTile tile{.north_index = north, .east_index = east, .level = 3, .size = size, .revision = revision};
  std::mt19937 random(seed * 7919U + static_cast<unsigned>(north * 131 + east));
  std::normal_distribution<double> noise(0, 0.01);
  for (int i = 0; i < HeightTile::kSide; ++i) {
    for (int j = 0; j < HeightTile::kSide; ++j) {
      const double x = tile.north0() + i * tile.spacing(), y = tile.east0() + j * tile.spacing();
      HeightTile::Node& node = tile.at(i, j);
      if (i + 0.4 * j + std::sin(j) > seen * 1.5 * HeightTile::kCells) continue;
      const double boulders = 0.25 * std::max(0.0, std::sin(1.7 * x) * std::sin(1.3 * y + 0.5));
      node.depth = static_cast<float>(20 + 0.1 * x + 0.05 * y + 0.05 * std::sin(7 * x + 2 * y) - boulders +
                                      noise(random));
      node.sigma = 0.012F;
      node.coverage = 1;
      const double shade = 110 + 60 * std::sin(3 * x) * std::cos(2 * y) + 300 * noise(random);
      // Green-grey sand with patches of brown and of violet growth.
      const double brown = std::max(0.0, std::sin(1.1 * x + 0.7) * std::sin(0.9 * y));
      const double violet = std::max(0.0, -std::sin(0.8 * x) * std::sin(1.2 * y + 2));
      const auto channel = [](double v) { return static_cast<std::uint8_t>(std::clamp(v, 0.0, 255.0)); };
      node.colour = {channel(shade * (0.75 + 0.45 * brown + 0.3 * violet)),
                     channel(shade * (1 - 0.3 * violet)),
                     channel(shade * (0.85 - 0.5 * brown + 0.4 * violet))};
    }
  }
  return tile;
}

}  // namespace fathom::telemetry
