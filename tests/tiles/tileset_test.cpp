#include "recon/products/tiles/tileset.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/support/test_data.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::json;

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

}  // namespace
}  // namespace fathom::topside
