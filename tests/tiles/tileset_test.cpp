#include <gmock/gmock.h>

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/products/tiles/check/tile_check.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/tiles.hpp"

namespace fathom::topside {
namespace {

using ::testing::HasSubstr, ::testing::IsEmpty;
using Json = nlohmann::json;
using fathom::test::TemporaryFolder, test::SyntheticModel;

Json readJson(const std::filesystem::path& path) {
  std::ifstream file(path);
  return Json::parse(file);
}

// Entries of a whole pyramid over one root, each as tall as its place says.
std::vector<TileEntry> pyramid(int levels, int x0 = 0, int y0 = 0) {
  const TileGrid grid;
  std::vector<TileEntry> entries;
  for (int level = 0; level < levels; ++level) {
    const int along = 1 << (2 * (levels - 1 - level));
    for (int x = x0 * along; x < (x0 + 1) * along; ++x)
      for (int y = y0 * along; y < (y0 + 1) * along; ++y) {
        const auto box = grid.box({level, x, y});
        entries.push_back({{level, x, y},
                           {box[0], box[1], 20},
                           {box[2], box[3], 21},
                           0.004 * level,
                           0.001 * std::pow(4, level)});
      }
  }
  return entries;
}

struct Walk {
  std::set<std::string> contents;
  std::size_t tiles = 0, files = 0, largest_file = 0;
};

// Every tile of the tileset and of those that it names: boxes hold children, errors fall.
void walk(const std::filesystem::path& path, Walk& seen) {
  const Json tileset = readJson(path);
  ++seen.files;
  std::size_t here = 0;
  const std::function<void(const Json&)> visit = [&](const Json& tile) {
    ++seen.tiles;
    ++here;
    if (tile.contains("content")) {
      const std::filesystem::path content =
          (path.parent_path() / tile["content"]["uri"].get<std::string>()).lexically_normal();
      if (content.extension() == ".json")
        walk(content, seen);
      else
        EXPECT_TRUE(seen.contents.insert(content.string()).second) << content;
    }
    if (!tile.contains("children")) {
      if (!tile["content"]["uri"].get<std::string>().ends_with(".json")) {
        EXPECT_EQ(tile["geometricError"], 0);
      }
      return;
    }
    const Json& box = tile["boundingVolume"]["box"];
    // What shows nothing by itself must be replaced by its children from wherever they can be seen.
    if (!tile.contains("content")) {
      EXPECT_GE(tile["geometricError"].get<double>(), 2 * box[3].get<double>());
    }
    for (const Json& child : tile["children"]) {
      EXPECT_LT(child["geometricError"].get<double>(), tile["geometricError"].get<double>());
      const Json& inner = child["boundingVolume"]["box"];
      for (int axis = 0; axis < 3; ++axis) {
        const auto at = [axis](const Json& b, int sign) {
          return b[axis].get<double>() + sign * b[3 + 4 * axis].get<double>();
        };
        EXPECT_GE(at(inner, -1), at(box, -1) - 1e-9);
        EXPECT_LE(at(inner, 1), at(box, 1) + 1e-9);
      }
      visit(child);
    }
  };
  visit(tileset["root"]);
  seen.largest_file = std::max(seen.largest_file, here);
}

TEST(Tileset, OneFileHoldsAllTilesOfASmallModelWithBoxesAndErrorsInOrder) {
  const fathom::test::TemporaryFolder scratch;
  writeTilesets(scratch.path(), pyramid(3), {});
  Walk seen;
  walk(scratch.path() / "tileset.json", seen);
  EXPECT_EQ(seen.files, 1U);
  EXPECT_EQ(seen.contents.size(), 1U + 16 + 256);
  EXPECT_TRUE(seen.contents.contains((scratch.path() / "1/3_2.glb").string()));
}

TEST(Tileset, TilesAboutTheOriginGetARootThatIsNeverShownInTheirPlace) {
  const fathom::test::TemporaryFolder scratch;
  std::vector<TileEntry> entries;
  for (const auto& [x, y] : {std::pair{-1, -1}, {-1, 0}, {0, -1}, {0, 0}})
    entries.push_back({{1, x, y}, {8.0 * x, 8.0 * y, 10}, {8.0 * x + 8, 8.0 * y + 8, 11}, 0.05, 0.0048});
  writeTilesets(scratch.path(), entries, {});
  const Json root = readJson(scratch.path() / "tileset.json")["root"];
  EXPECT_FALSE(root.contains("content"));
  EXPECT_EQ(root["children"].size(), 4U);
  Walk seen;
  walk(scratch.path() / "tileset.json", seen);
  EXPECT_EQ(seen.contents.size(), 4U);
}

TEST(Tileset, ALargeModelIsCutIntoFilesThatTogetherHoldEveryTileOnce) {
  const fathom::test::TemporaryFolder scratch;
  writeTilesets(scratch.path(), pyramid(5), {}, {.max_tiles = 1000});
  Walk seen;
  walk(scratch.path() / "tileset.json", seen);
  EXPECT_EQ(seen.files, 257U);
  EXPECT_EQ(seen.contents.size(), 1U + 16 + 256 + 4096 + 65536);
  EXPECT_LE(seen.largest_file, 1000U);
}

TEST(Tileset, OrderOfEntriesDoesNotMatter) {
  const fathom::test::TemporaryFolder a, b;
  std::vector<TileEntry> entries = pyramid(3);
  writeTilesets(a.path(), entries, {});
  std::reverse(entries.begin(), entries.end());
  std::swap(entries[3], entries[40]);
  writeTilesets(b.path(), entries, {});
  EXPECT_EQ(readJson(a.path() / "tileset.json").dump(), readJson(b.path() / "tileset.json").dump());
}

TEST(Tileset, RootsOnAllSidesOfTheOriginStandUnderOneWithoutContent) {
  const fathom::test::TemporaryFolder scratch;
  std::vector<TileEntry> entries;
  for (const auto& [x, y] :
       {std::pair(0, 0), std::pair(-1, 0), std::pair(0, -1), std::pair(-1, -1), std::pair(2, 1)})
    for (const TileEntry& entry : pyramid(2, x, y)) entries.push_back(entry);
  writeTilesets(scratch.path(), entries, {});
  Walk seen;
  walk(scratch.path() / "tileset.json", seen);
  EXPECT_EQ(seen.contents.size(), 5U * 17);
  EXPECT_FALSE(readJson(scratch.path() / "tileset.json")["root"].contains("content"));
}

TEST(Tileset, ATileWhoseParentIsMissingIsReachedAllTheSame) {
  const fathom::test::TemporaryFolder scratch;
  std::vector<TileEntry> entries = pyramid(3);
  std::erase_if(entries, [](const TileEntry& e) { return e.id == TileId{1, 0, 0}; });
  writeTilesets(scratch.path(), entries, {});
  Walk seen;
  walk(scratch.path() / "tileset.json", seen);
  EXPECT_EQ(seen.contents.size(), 1U + 15 + 256);
  EXPECT_TRUE(seen.contents.contains((scratch.path() / "0/0_0.glb").string()));
}

TEST(Tileset, RootStandsOnTheEarthWhereTheOriginIs) {
  // WGS84's own radii stand at the equator and at the pole.
  EXPECT_TRUE((ecefFromEnu({0, 0}).col(3).isApprox(Eigen::Vector4d(6378137, 0, 0, 1), 1e-12)));
  EXPECT_NEAR(ecefFromEnu({90 * kRadiansPerDegree, 0})(2, 3), 6356752.3142, 1e-4);
  const Eigen::Matrix4d m = ecefFromEnu({-31.95 * kRadiansPerDegree, 115.86 * kRadiansPerDegree});
  const Eigen::Matrix3d turn = m.topLeftCorner<3, 3>();
  EXPECT_TRUE((turn.transpose() * turn).isIdentity(1e-12));
  EXPECT_NEAR(turn.determinant(), 1, 1e-12);
  // A small step north and one east on the ellipsoid go where the matrix says.
  const double step = 1e-6;  // [rad]
  const Eigen::Vector3d north =
      (ecefFromEnu({-31.95 * kRadiansPerDegree + step, 115.86 * kRadiansPerDegree}) - m).col(3).head<3>();
  const Eigen::Vector3d east =
      (ecefFromEnu({-31.95 * kRadiansPerDegree, 115.86 * kRadiansPerDegree + step}) - m).col(3).head<3>();
  EXPECT_GT(north.normalized().dot(turn.col(1)), 1 - 1e-9);
  EXPECT_GT(east.normalized().dot(turn.col(0)), 1 - 1e-9);
  const fathom::test::TemporaryFolder scratch;
  writeTilesets(scratch.path(), pyramid(1), Geodetic{-31.95 * kRadiansPerDegree, 115.86 * kRadiansPerDegree});
  const Json transform = readJson(scratch.path() / "tileset.json")["root"]["transform"];
  for (int k = 0; k < 16; ++k) EXPECT_EQ(transform[k].get<double>(), m.data()[k]);
}

TEST(Tileset, RefusesNoTilesAndATileTwice) {
  const fathom::test::TemporaryFolder scratch;
  EXPECT_THROW(writeTilesets(scratch.path(), {}, {}), std::invalid_argument);
  std::vector<TileEntry> twice = pyramid(1);
  twice.push_back(twice.front());
  EXPECT_THROW(writeTilesets(scratch.path(), twice, {}), std::invalid_argument);
}

constexpr std::uint64_t kCells = SyntheticModel::kCells;

// Two levels, 17 tiles, each changed by `change` before it is written.
void writeModel(const std::filesystem::path& folder, const std::function<void(TexturedTile&)>& change = {}) {
  SyntheticModel model{.texels = 16};
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
