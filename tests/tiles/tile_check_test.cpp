#include "recon/products/tiles/check/tile_check.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "realtime/base/input_error.hpp"
#include "recon/products/tiles/check/border_edges.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/tiles/synthetic_model.hpp"

namespace fathom::topside {
namespace {

using fathom::test::TemporaryFolder;
using synthetic::SyntheticModel;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::uint64_t kCells = SyntheticModel::kCells;

// Two levels, 17 tiles, each changed by `change` before it is written.
void writeModel(const std::filesystem::path& folder, const std::function<void(TexturedTile&)>& change = {}) {
  SyntheticModel model;
  model.texels = 16;
  std::vector<TileEntry> entries;
  for (const TileId& id : model.pyramid(2)) {
    TexturedTile tile = model.tile(id);
    if (change) change(tile);
    entries.push_back(entryOf(tile));
    fathom::test::writeBytes(folder / tilePath(id), writeGlb(tile, model.grid, {}));
  }
  writeTilesets(folder, entries, {});
}

void replaceIn(const std::filesystem::path& path, const std::string& from, const std::string& to) {
  fathom::test::writeText(path, fathom::test::replaced(fathom::test::readText(path), from, to));
}

TEST(TileCheck, AModelWithoutFaultsHasEveryEdgeOfEveryBorderTwice) {
  const TemporaryFolder scratch;
  writeModel(scratch.path() / "tiles");
  const TileCheck check = checkTiles(scratch.path());
  EXPECT_THAT(check.faults, IsEmpty());
  EXPECT_EQ(check.tiles, 17U);
  EXPECT_EQ(check.levels, 2U);
  EXPECT_EQ(check.edges_between_tiles, 2 * 3 * 4 * kCells);
  EXPECT_EQ(check.edges_between_levels, 4 * 4 * kCells);
  EXPECT_EQ(check.cracks_between_tiles + check.cracks_between_levels, 0U);
  EXPECT_EQ(check.texels, 17U * 16 * 16);
}

TEST(TileCheck, AVertexMovedByOneStepOnABorderIsACrack) {
  const TemporaryFolder scratch;
  writeModel(scratch.path(), [](TexturedTile& tile) {
    if (tile.surface.tile != TileId{0, 1, 1}) return;
    for (std::size_t k = 0; k < tile.surface.shared.size(); ++k)
      if (tile.surface.shared[k] == kHighNorth) {
        tile.surface.mesh.vertices[k].z() += static_cast<float>(TileGrid::kLattice);
        return;
      }
  });
  const TileCheck check = checkTiles(scratch.path());
  EXPECT_EQ(check.cracks_between_tiles, 2U);  // both edges of the vertex
  ASSERT_EQ(check.faults.size(), 1U);
  EXPECT_THAT(check.faults[0], HasSubstr("0/1_1 and 0/2_1"));
}

TEST(TileCheck, ACoarseTileWithoutAVertexThatFineTilesHaveIsACrack) {
  const TemporaryFolder scratch;
  writeModel(scratch.path(), [](TexturedTile& tile) {
    if (tile.surface.tile.level != 1) return;
    // The finest neighbour's vertex falls onto the one before it along the side: one edge for two.
    Mesh& mesh = tile.surface.mesh;
    std::vector<std::size_t> side;
    for (std::size_t k = 0; k < mesh.vertices.size(); ++k)
      if (tile.surface.shared[k] == kLowEast) side.push_back(k);
    mesh.vertices[side[5]] = mesh.vertices[side[6]];
  });
  const TileCheck check = checkTiles(scratch.path());
  EXPECT_GT(check.cracks_between_levels, 0U);
  EXPECT_EQ(check.cracks_between_tiles, 0U);
}

TEST(TileCheck, ASurfaceThatEndsAtABorderIsNoCrack) {
  const TemporaryFolder scratch;
  writeModel(scratch.path(), [](TexturedTile& tile) {
    // Nothing was seen of the row of squares along one side.
    if (tile.surface.tile != TileId{0, 0, 2}) return;
    std::erase_if(tile.surface.mesh.triangles, [&](const std::array<std::uint32_t, 3>& t) {
      return std::any_of(t.begin(), t.end(),
                         [&](std::uint32_t k) { return tile.surface.shared[k] & kHighNorth; });
    });
  });
  const TileCheck check = checkTiles(scratch.path());
  EXPECT_EQ(check.cracks_between_tiles, 0U);
  EXPECT_GE(check.open_edges, kCells);
}

TEST(TileCheck, SurfacesThatEndOnBothSidesOfABorderAStepPastEachOtherAreNoCrack) {
  const auto edge = [](int from, int to) { return BorderEdge{{from, from / 6}, {to, to / 6}}; };
  const std::vector<BorderEdge> here{edge(0, 60), edge(60, 121)};
  const auto turned = [](std::vector<BorderEdge> edges) {
    for (BorderEdge& e : edges) std::swap(e.from, e.to);
    std::sort(edges.begin(), edges.end());
    return edges;
  };
  const BorderMatch ends = matchNeighbours(here, turned({edge(0, 60), edge(120, 200)}), 0.033);
  EXPECT_EQ(ends.equal, 1U);
  EXPECT_EQ(ends.cracks, 0U);
  EXPECT_EQ(ends.open, 2U);
  const BorderMatch torn = matchNeighbours(here, turned({edge(0, 60), edge(60, 100), edge(100, 121)}), 0.033);
  EXPECT_EQ(torn.cracks, 1U);
}

TEST(TileCheck, SurfacesThatEndOnBothSidesOfABorderOnASteepSlopeAreNoCrack) {
  // Down a wall: one tile's surface ends at the second place, the other's begins again at the third. Both
  // edges stand over the same few steps of the side, an edge's length apart in depth.
  const std::vector<BorderEdge> here{{{9632, -24263}, {9644, -24330}}, {{9652, -24195}, {9632, -24263}}};
  const std::vector<BorderEdge> below{{{9665, -24377}, {9644, -24330}}};
  for (const bool swapped : {false, true}) {
    const BorderMatch ends =
        swapped ? matchNeighbours(below, here, 0.033) : matchNeighbours(here, below, 0.033);
    EXPECT_EQ(ends.cracks, 0U);
    EXPECT_EQ(ends.open, 3U);
  }
  // A vertex of a wall that the neighbour has elsewhere.
  const std::vector<BorderEdge> moved{{{9630, -24262}, {9652, -24195}}, {{9644, -24330}, {9630, -24262}}};
  EXPECT_EQ(matchNeighbours(here, moved, 0.033).cracks, 2U);
  const std::vector<BorderEdge> one{{{9644, -24330}, {9652, -24195}}};
  EXPECT_EQ(matchNeighbours(here, one, 0.033).cracks, 2U);
}

TEST(TileCheck, FilesThatAreMissingDamagedSwappedOrUnlistedAreFaults) {
  const TemporaryFolder scratch;
  const auto& folder = scratch.path();
  writeModel(folder);
  std::filesystem::remove(folder / "0/0_0.glb");
  std::filesystem::resize_file(folder / "0/1_0.glb", 700);
  std::filesystem::copy_file(folder / "0/2_1.glb", folder / "0/2_2.glb",
                             std::filesystem::copy_options::overwrite_existing);
  fathom::test::writeBytes(folder / "0/77_0.glb", {1, 2, 3});
  const TileCheck check = checkTiles(folder);
  EXPECT_THAT(check.faults, ::testing::Contains(HasSubstr("0/0_0.glb")));
  EXPECT_THAT(check.faults, ::testing::Contains(HasSubstr("0/1_0.glb")));
  EXPECT_THAT(check.faults, ::testing::Contains(HasSubstr("0/2_2.glb: holds the tile of 0/2_1.glb")));
  EXPECT_THAT(check.faults, ::testing::Contains(HasSubstr("0/77_0.glb: no tileset lists it")));
}

TEST(TileCheck, TilesetsThatBreakTheRulesAreFaults) {
  const std::array<std::array<std::string, 3>, 6> breaks{{
      {"\"version\":\"1.1\"", "\"version\":\"9\"", "asset.version"},
      {"0/0_0.glb", "../0_0.glb", "leads out of the folder"},
      {"0/0_0.glb", "0/0_1.glb", "listed twice"},
      {"\"children\":[", "\"children\":[7,", "a child that is no tile"},
      {"\"geometricError\":0.0", "\"geometricError\":99", "not less than its parent's"},
      {"\"box\":[", "\"box\":[1,", "without a box"},
  }};
  for (const auto& [from, to, said] : breaks) {
    const TemporaryFolder scratch;
    writeModel(scratch.path());
    replaceIn(scratch.path() / "tileset.json", from, to);
    EXPECT_THAT(checkTiles(scratch.path()).faults, ::testing::Contains(HasSubstr(said))) << to;
  }
}

TEST(TileCheck, AFolderWithoutATilesetIsAnInputError) {
  const TemporaryFolder scratch;
  EXPECT_THROW(static_cast<void>(checkTiles(scratch.path())), InputError);
  fathom::test::writeBytes(scratch.path() / "tileset.json", {'[', '1', '2'});
  EXPECT_THROW(static_cast<void>(checkTiles(scratch.path())), InputError);
  EXPECT_THROW(static_cast<void>(checkTiles(scratch.path() / "nowhere")), InputError);
}

}  // namespace
}  // namespace fathom::topside
