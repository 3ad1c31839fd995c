#include "recon/products/tiles/model_file.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/ply_reader.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/tiles/synthetic_model.hpp"

namespace fathom::topside {
namespace {

using fathom::test::TemporaryFolder;
using synthetic::SyntheticModel;

// Tiles on both sides of the origin, handed over as if they had been read.
struct Square {
  SyntheticModel model;
  std::vector<TileId> tiles;
  Square() {
    model.texels = 256;
    for (int x = 1; x >= -1; --x)
      for (int y = -1; y <= 1; ++y) tiles.push_back({0, x, y});
  }
  [[nodiscard]] TileSource source() const {
    return [this](const TileId& id) { return readGlb(writeGlb(model.tile(id), model.grid, {}), "tile"); };
  }
};

constexpr int kAlong = 3 * SyntheticModel::kCells + 1;

TEST(ModelFile, PlyIsOneSurfaceWhoseOnlyBorderIsTheModels) {
  const Square square;
  const TemporaryFolder scratch;
  const ModelCounts counts =
      writeModelPly(scratch.path() / "model.ply", square.tiles, square.source(), {"a reef"});
  const Mesh mesh = readPly(scratch.path() / "model.ply");
  EXPECT_EQ(mesh.vertices.size(), static_cast<std::size_t>(kAlong * kAlong));
  EXPECT_EQ(counts.vertices, mesh.vertices.size());
  EXPECT_EQ(counts.triangles, mesh.triangles.size());
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& t : mesh.triangles)
    for (std::size_t c = 0; c < 3; ++c) ++edges[std::minmax(t[c], t[(c + 1) % 3])];
  int open = 0;
  for (const auto& [edge, uses] : edges) {
    EXPECT_LE(uses, 2);
    open += uses == 1;
  }
  EXPECT_EQ(open, 4 * (kAlong - 1));
}

TEST(ModelFile, PlyStandsUprightWithColoursAndSigma) {
  const Square square;
  const TemporaryFolder scratch;
  writeModelPly(scratch.path() / "model.ply", square.tiles, square.source());
  const Mesh mesh = readPly(scratch.path() / "model.ply");
  ASSERT_EQ(mesh.sigma.size(), mesh.vertices.size());
  ASSERT_EQ(mesh.colours.size(), mesh.vertices.size());
  double off = 0;
  for (std::size_t k = 0; k < mesh.vertices.size(); ++k) {
    const Eigen::Vector3d v = mesh.vertices[k].cast<double>();
    EXPECT_NEAR(v.z(), -SyntheticModel::depth(v.y(), v.x()), 0.001);
    EXPECT_GT(mesh.normals[k].z(), 0.5F);
    off += std::abs(mesh.colours[k][0] - SyntheticModel::colour(v.y(), v.x())[0]);
  }
  EXPECT_LT(off / static_cast<double>(mesh.vertices.size()), 4);
}

TEST(ModelFile, OrderOfTilesDoesNotMatterAndNothingElseIsLeftBehind) {
  Square square;
  const TemporaryFolder scratch;
  writeModelPly(scratch.path() / "a.ply", square.tiles, square.source());
  std::reverse(square.tiles.begin(), square.tiles.end());
  writeModelPly(scratch.path() / "b.ply", square.tiles, square.source());
  const auto text = [&](const char* name) { return fathom::test::readText(scratch.path() / name); };
  EXPECT_EQ(text("a.ply"), text("b.ply"));
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(scratch.path()))
    names.insert(entry.path().filename().string());
  EXPECT_EQ(names, (std::set<std::string>{"a.ply", "b.ply"}));
}

TEST(ModelFile, ObjNamesPicturesThatAreThereAndCornersThatExist) {
  const Square square;
  const TemporaryFolder scratch;
  const ModelCounts counts = writeModelObj(scratch.path() / "model.obj", square.tiles, square.source());
  EXPECT_EQ(counts.vertices, static_cast<std::uint64_t>(kAlong * kAlong));
  std::ifstream file(scratch.path() / "model.obj");
  std::uint64_t vertices = 0, textures = 0, faces = 0, materials = 0;
  for (std::string line, word; std::getline(file, line);) {
    std::istringstream words(line);
    words >> word;
    vertices += word == "v";
    textures += word == "vt";
    materials += word == "usemtl";
    if (word != "f") continue;
    ++faces;
    for (int c = 0; c < 3; ++c) {
      std::uint64_t vertex = 0, texture = 0;
      char slash = 0;
      words >> vertex >> slash >> texture;
      ASSERT_EQ(slash, '/');
      ASSERT_TRUE(vertex >= 1 && vertex <= vertices);
      ASSERT_TRUE(texture >= 1 && texture <= textures);
    }
  }
  EXPECT_EQ(vertices, counts.vertices);
  EXPECT_EQ(faces, counts.triangles);
  EXPECT_EQ(materials, 9U);
  std::ifstream list(scratch.path() / "model.mtl");
  int pictures = 0;
  for (std::string line; std::getline(list, line);)
    if (line.starts_with("map_Kd ")) {
      EXPECT_TRUE(std::filesystem::exists(scratch.path() / line.substr(7))) << line;
      ++pictures;
    }
  EXPECT_EQ(pictures, 9);
}

TEST(ModelFile, TilesOfALevelAreFoundByTheirNames) {
  const SyntheticModel model;
  const TemporaryFolder scratch;
  for (const TileId& id : {TileId{2, -3, 4}, TileId{2, 10, -1}, TileId{1, 0, 0}}) {
    std::filesystem::create_directories((scratch.path() / tilePath(id)).parent_path());
    const auto bytes = writeGlb(model.tile(id), model.grid, {});
    std::ofstream(scratch.path() / tilePath(id), std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  }
  std::ofstream(scratch.path() / "2/notes.glb") << "no tile";
  EXPECT_EQ(tilesOfLevel(scratch.path(), 2), (std::vector<TileId>{{2, -3, 4}, {2, 10, -1}}));
  EXPECT_TRUE(tilesOfLevel(scratch.path(), 7).empty());
  EXPECT_EQ(glbSource(scratch.path())({2, 10, -1}).tile.surface.tile, (TileId{2, 10, -1}));
  EXPECT_THROW(static_cast<void>(glbSource(scratch.path())({2, 0, 0})), InputError);
}

TEST(ModelFile, ATileThatCannotBeReadLeavesNothing) {
  const Square square;
  const TemporaryFolder scratch;
  const TileSource broken = [&](const TileId& id) {
    if (id.x == 1) throw InputError("tile", "", "is damaged");
    return square.source()(id);
  };
  EXPECT_THROW(writeModelPly(scratch.path() / "model.ply", square.tiles, broken), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(scratch.path()));
}

}  // namespace
}  // namespace fathom::topside
