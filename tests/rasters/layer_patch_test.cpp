#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>

#include "realtime/base/units.hpp"
#include "recon/products/rasters/layer_patch.hpp"
#include "recon/products/rasters/patch_mosaic.hpp"
#include "recon/products/rasters/terrain.hpp"
#include "tests/world/tiles.hpp"

namespace fathom::topside {
namespace {

using test::fieldTile;

double gentle(double n, double e) {
  return 30 + 0.2 * n - 0.1 * e;
}

TEST(LayerPatch, ASlopesElevationIsThatOfEachCellsMiddle) {
  const TileGrid grid;
  const LayerPatch patch = makeLayerPatch(fieldTile({0, 3, -2}, grid, 0.066, gentle), grid, {0.033, 0.02});
  ASSERT_EQ(patch.surface.rows, 64);
  ASSERT_EQ(patch.surface.columns, 64);
  for (int i = 0; i < 64; ++i) {
    for (int j = 0; j < 64; ++j) {
      const std::size_t at = patch.surface.at(i, j);
      const double north = (patch.surface.x + i + 0.5) * 0.033, east = (patch.surface.y + j + 0.5) * 0.033;
      ASSERT_NEAR(patch.elevation[at], -gentle(north, east), 6e-4);  // the lattice's step
      ASSERT_NEAR(patch.sigma[at], 0.004, 1e-6);
      ASSERT_EQ(patch.views[at], 3);
    }
  }
}

TEST(LayerPatch, TilesOfAnyCellSizeCoverEveryCellOnce) {
  const TileGrid grid;
  for (const double cell : {0.005, 0.0123, 0.033, 0.1, 0.5}) {
    CellWindow before = cellsOf({0, -9, -9}, grid, cell);
    for (std::int32_t k = -8; k < 9; ++k) {
      const CellWindow window = cellsOf({0, k, k}, grid, cell);
      EXPECT_EQ(before.x + before.rows, window.x) << cell << ' ' << k;
      EXPECT_EQ(before.y + before.columns, window.y) << cell << ' ' << k;
      before = window;
    }
  }
}

TEST(LayerPatch, NeighboursJoinWithoutAGap) {
  const TileGrid grid;
  for (const LayerCells& cells : {LayerCells{0.033, 0.005}, LayerCells{0.02, 0.0077}}) {
    std::vector<TileId> tiles;
    for (std::int32_t x = -1; x < 2; ++x)
      for (std::int32_t y = 6; y < 8; ++y) tiles.push_back({0, x, y});
    PatchMosaic mosaic(grid, cells, tiles, [&](const TileId& tile) {
      return packLayerPatch(makeLayerPatch(fieldTile(tile, grid, 0.132, gentle), grid, cells));
    });
    const auto surface = mosaic.surface(mosaic.surfaceExtent());
    for (const float v : surface.elevation) ASSERT_TRUE(std::isfinite(v));
    const CellWindow window = mosaic.mosaicExtent();
    std::vector<std::uint8_t> rgba(4 * window.cells());
    mosaic.colours(window, rgba.data());
    for (std::size_t k = 3; k < rgba.size(); k += 4) ASSERT_EQ(rgba[k], 255);
  }
}

TEST(LayerPatch, TheUpperOfTwoSurfacesIsSeen) {
  const TileGrid grid;
  TexturedTile tile = fieldTile({0, 0, 0}, grid, 0.132, [](double, double) { return 20; });
  // A ledge 0.5 m above a part of it.
  const auto first = static_cast<std::uint32_t>(tile.surface.mesh.vertices.size());
  for (const auto& [n, e] : {std::pair{0.5F, 0.5F}, {0.5F, 1.0F}, {1.0F, 0.5F}}) {
    tile.surface.mesh.vertices.emplace_back(n, e, 19.5F);
    tile.surface.mesh.colours.push_back({200, 0, 0});
    tile.surface.mesh.sigma.push_back(0.01F);
    tile.surface.views.push_back(9);
  }
  tile.surface.mesh.triangles.push_back({first, first + 1, first + 2});
  std::rotate(tile.surface.mesh.triangles.begin(), tile.surface.mesh.triangles.end() - 1,
              tile.surface.mesh.triangles.end());  // drawn first or last, it is on top
  const LayerPatch patch = makeLayerPatch(tile, grid, {0.033, 0.005});
  const auto surface_at = patch.surface.at(18, 18);  // 0.61 m
  EXPECT_FLOAT_EQ(patch.elevation[surface_at], -19.5F);
  EXPECT_EQ(patch.views[surface_at], 9);
  EXPECT_FLOAT_EQ(patch.elevation[patch.surface.at(40, 40)], -20);
  EXPECT_EQ(patch.rgba[4 * patch.mosaic.at(120, 120)], 200);
}

TEST(LayerPatch, AMosaicCellIsTheMeanOfItsTexels) {
  const TileGrid grid;
  TexturedTile tile = fieldTile({0, 0, 0}, grid, 1.056, [](double, double) { return 5; });
  // A chequered atlas over the whole tile, four texels a cell's side.
  const double edge = grid.edge(0), cell = 0.033;
  tile.atlas.width = tile.atlas.height = 256;
  tile.texel = edge / 256;
  for (int y = 0; y < 256; ++y)
    for (int x = 0; x < 256; ++x)
      for (int c = 0; c < 3; ++c)
        tile.atlas.rgb.push_back(static_cast<std::uint8_t>((x + y) % 2 == 0 ? 40 + x / 4 : 80 + x / 4));
  for (const auto& v : tile.surface.mesh.vertices)
    tile.surface.mesh.texture_coordinates.emplace_back(v.y() / edge, v.x() / edge);
  const LayerPatch patch = makeLayerPatch(tile, grid, {0.033, cell});
  for (int j = 1; j < 63; ++j) {
    const std::uint8_t* rgba = &patch.rgba[4 * patch.mosaic.at(30, j)];
    EXPECT_NEAR(rgba[0], 60 + j, 1.5) << j;
    EXPECT_EQ(rgba[3], 255);
  }
}

TEST(LayerPatch, PackedPatchesComeBackAndBrokenOnesAreRefused) {
  const TileGrid grid;
  TexturedTile tile = fieldTile({0, 5, 7}, grid, 0.132, gentle);
  tile.surface.mesh.triangles.resize(tile.surface.mesh.triangles.size() / 2);  // holes
  const LayerPatch patch = makeLayerPatch(tile, grid, {0.033, 0.01});
  const auto bytes = packLayerPatch(patch);
  EXPECT_EQ(bytes, packLayerPatch(patch));
  const LayerPatch back = unpackLayerPatch(bytes, PatchPart::kBoth);
  EXPECT_EQ(back.tile, patch.tile);
  EXPECT_EQ(back.cells, patch.cells);
  EXPECT_EQ(back.rgba, patch.rgba);
  EXPECT_EQ(back.views, patch.views);
  for (std::size_t k = 0; k < patch.elevation.size(); ++k) {
    ASSERT_EQ(std::isnan(back.elevation[k]), std::isnan(patch.elevation[k]));
    if (std::isnan(patch.elevation[k])) continue;
    ASSERT_NEAR(back.elevation[k], patch.elevation[k], 6e-5);
    ASSERT_NEAR(back.sigma[k], patch.sigma[k], 6e-5);
  }
  EXPECT_TRUE(unpackLayerPatch(bytes, PatchPart::kSurface).rgba.empty());
  EXPECT_TRUE(unpackLayerPatch(bytes, PatchPart::kMosaic).elevation.empty());
  for (std::size_t size = 0; size < bytes.size(); size += 97)
    EXPECT_THROW((void)unpackLayerPatch({bytes.data(), size}, PatchPart::kBoth), std::runtime_error);
  for (std::size_t place = 0; place < 80; ++place) {
    auto other = bytes;
    other[place] ^= 0x40;
    try {
      (void)unpackLayerPatch(other, PatchPart::kBoth);
    } catch (const std::runtime_error&) {
    }
  }
}

TEST(LayerPatch, AnEmptyTileHasAnEmptyPatch) {
  const TileGrid grid;
  TexturedTile tile;
  const LayerPatch patch = makeLayerPatch(tile, grid, {});
  for (const float v : patch.elevation) ASSERT_TRUE(std::isnan(v));
  for (const std::uint8_t v : patch.rgba) ASSERT_EQ(v, 0);
  EXPECT_EQ(unpackLayerPatch(packLayerPatch(patch), PatchPart::kBoth).rgba, patch.rgba);
  EXPECT_THROW((void)makeLayerPatch(tile, grid, {0, 0.005}), std::invalid_argument);
  tile.surface.tile.level = 1;
  EXPECT_THROW((void)makeLayerPatch(tile, grid, {}), std::invalid_argument);
}

struct Field {
  std::vector<float> elevation;
  TerrainView view;
  // Elevation [m] of north and east [m] from the view's first cell.
  template <typename F>
  Field(int rows, int columns, int halo, double cell, F&& up) {
    for (int i = -halo; i < rows + halo; ++i)
      for (int j = -halo; j < columns + halo; ++j)
        elevation.push_back(static_cast<float>(up(i * cell, j * cell)));
    view = {elevation.data(), rows, columns, halo, cell};
  }
};

TEST(Terrain, APlanesSlopeAndAspectAreItsOwn) {
  for (const double aspect : {0.0, 35.0, 90.0, 200.0, 315.0}) {
    const double fall = std::tan(20 * kRadiansPerDegree);
    Field field(40, 50, 4, 0.033, [&](double n, double e) {
      return -3000 -
             fall * (n * std::cos(aspect * kRadiansPerDegree) + e * std::sin(aspect * kRadiansPerDegree));
    });
    const SlopeAspect result = slopeAspect(field.view, {4, 0.5});
    for (std::size_t k = 0; k < result.slope.size(); ++k) {
      ASSERT_NEAR(result.slope[k], 20, 0.05) << aspect;
      const double difference = std::remainder(static_cast<double>(result.aspect[k]) - aspect, 360.0);
      ASSERT_NEAR(difference, 0, 0.1) << aspect;
      ASSERT_GE(result.aspect[k], 0);
      ASSERT_LT(result.aspect[k], 360);
    }
    for (const float r : rugosity(field.view, {4, 0.5}))
      ASSERT_NEAR(r, 1, 5e-4);  // single precision 3 km down
  }
}

TEST(Terrain, LevelGroundHasNoAspect) {
  Field field(8, 8, 1, 0.1, [](double, double) { return -12; });
  const SlopeAspect result = slopeAspect(field.view, {1, 0.5});
  for (const float s : result.slope) EXPECT_EQ(s, 0);
  for (const float a : result.aspect) EXPECT_TRUE(std::isnan(a));
}

// Length of z = A sin(k x) over a wave, by fine steps.
double waveLength(double amplitude, double wave) {
  double length = 0;
  constexpr int kSteps = 100'000;
  for (int i = 0; i < kSteps; ++i) {
    const double slope =
        amplitude * 2 * std::numbers::pi / wave * std::cos(2 * std::numbers::pi * (i + 0.5) / kSteps);
    length += std::sqrt(1 + slope * slope) * wave / kSteps;
  }
  return length / wave;
}

TEST(Terrain, ACorrugatedSurfacesRugosityIsTheLengthOfItsWaves) {
  constexpr double kCell = 0.01, kWave = 0.4;
  for (const double amplitude : {0.02, 0.05, 0.10}) {
    for (const double tilt : {0.0, 0.3}) {
      Field field(60, 60, 60, kCell, [&](double n, double e) {
        return amplitude * std::sin(2 * std::numbers::pi * n / kWave) + tilt * e;
      });
      // A window of three waves between its outer cells' middles.
      const std::vector<float> result = rugosity(field.view, {60, 0.5});
      // Along the waves' crests the tilt makes surface and projection longer alike, across it the waves
      // are less steep against the tilted plane: by the mean over a wave of the true area.
      double area = 0;
      constexpr int kSteps = 20'000;
      for (int i = 0; i < kSteps; ++i) {
        const double slope =
            amplitude * 2 * std::numbers::pi / kWave * std::cos(2 * std::numbers::pi * (i + 0.5) / kSteps);
        area += std::sqrt(1 + slope * slope + tilt * tilt) / kSteps;
      }
      const double expected = area / std::sqrt(1 + tilt * tilt);
      if (tilt == 0) {
        ASSERT_NEAR(expected, waveLength(amplitude, kWave), 1e-6);
      }
      // The plane of best fit of a whole number of sine waves leans a little with their phase.
      for (const float r : result) ASSERT_NEAR(r, expected, 0.012 * expected) << amplitude << ' ' << tilt;
    }
  }
}

TEST(Terrain, UnknownCellsAreLeftOutAndTooFewGiveNothing) {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  Field field(20, 20, 3, 0.05, [](double n, double e) { return -5 + 0.2 * n + 0.1 * e; });
  std::mt19937 random(4);
  for (std::size_t k = 0; k < field.elevation.size(); k += 1 + random() % 4) field.elevation[k] = kNaN;
  for (int i = 0; i < 26 * 10; ++i) field.elevation[static_cast<std::size_t>(i)] = kNaN;  // the southern part
  const SlopeAspect result = slopeAspect(field.view, {3, 0.4});
  const std::vector<float> rough = rugosity(field.view, {3, 0.4});
  int known = 0;
  const double slope = std::atan(std::hypot(0.2, 0.1)) / kRadiansPerDegree;
  for (int i = 0; i < 20; ++i) {
    for (int j = 0; j < 20; ++j) {
      const auto k = static_cast<std::size_t>(i * 20 + j);
      EXPECT_TRUE(i >= 6 || std::isnan(result.slope[k])) << i;
      if (std::isnan(result.slope[k])) continue;
      ++known;
      EXPECT_NEAR(result.slope[k], slope, 0.01);
      EXPECT_TRUE(std::isnan(rough[k]) || std::abs(rough[k] - 1) < 1e-4) << rough[k];
    }
  }
  EXPECT_GT(known, 50);
  Field nothing(5, 5, 2, 0.1, [&](double, double) { return kNaN; });
  for (const float v : slopeAspect(nothing.view, {2, 0.5}).slope) EXPECT_TRUE(std::isnan(v));
  for (const float v : rugosity(nothing.view, {2, 0.5})) EXPECT_TRUE(std::isnan(v));
}

TEST(Terrain, AWindowIsAtLeastThreeCellsWide) {
  EXPECT_EQ(radiusOf(0.25, 0.033), 4);
  EXPECT_EQ(radiusOf(1.0, 0.033), 15);
  EXPECT_EQ(radiusOf(0.3, 0.1), 1);
  EXPECT_EQ(radiusOf(0.01, 0.033), 1);
}

}  // namespace
}  // namespace fathom::topside
