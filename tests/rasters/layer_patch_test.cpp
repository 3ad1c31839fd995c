#include "recon/products/rasters/layer_patch.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "recon/products/rasters/patch_mosaic.hpp"
#include "tests/rasters/field_tiles.hpp"

namespace fathom::topside {
namespace {

using synthetic::fieldTile;

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

}  // namespace
}  // namespace fathom::topside
