#pragma once

#include <cmath>
#include <random>

#include "recon/geometry/height_tile.hpp"

namespace fathom::telemetry {

// Rubbly seafloor around 20 m, ripples and boulders, 1 cm of noise; every tile is its own (by key and seed),
// heights are continuous over tile borders apart from the noise. `seen`: share of the tile that is covered.
inline HeightTile sampleTile(std::int32_t north, std::int32_t east, double size = 4.0, double seen = 1.0,
                             unsigned seed = 1, std::uint32_t revision = 1) {
  HeightTile tile;
  tile.north_index = north;
  tile.east_index = east;
  tile.level = 3;
  tile.size = size;
  tile.revision = revision;
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
      node.colour = {static_cast<std::uint8_t>(shade * 0.7), static_cast<std::uint8_t>(shade),
                     static_cast<std::uint8_t>(shade * 0.9)};
    }
  }
  return tile;
}

}  // namespace fathom::telemetry
