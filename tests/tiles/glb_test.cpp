#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <random>
#include <set>
#include <sstream>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/model_file.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/tiles.hpp"

namespace fathom::topside {
namespace {

using Corner = std::array<float, 3>;
using Triangle = std::array<Corner, 3>;
using fathom::test::TemporaryFolder, test::SyntheticModel;

// A surface as a set of triangles by position, whatever the order of vertices; corners keep their turn.
std::multiset<Triangle> shapeOf(const Mesh& mesh) {
  std::multiset<Triangle> shape;
  for (const auto& t : mesh.triangles) {
    Triangle corners;
    for (std::size_t c = 0; c < 3; ++c) {
      const Eigen::Vector3f& v = mesh.vertices[t[c]];
      corners[c] = {v.x(), v.y(), v.z()};
    }
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    shape.insert(corners);
  }
  return shape;
}

std::map<Corner, std::size_t> byPlace(const Mesh& mesh) {
  std::map<Corner, std::size_t> places;
  for (std::size_t k = 0; k < mesh.vertices.size(); ++k)
    places[{mesh.vertices[k].x(), mesh.vertices[k].y(), mesh.vertices[k].z()}] = k;
  return places;
}

TEST(Glb, EveryTriangleComesBackToTheLastBitAtEveryLevelAndFarFromTheOrigin) {
  const SyntheticModel model;
  for (const TileId& id : {TileId{0, 0, 0}, TileId{0, 3000, -3200}, TileId{2, -7, 100}, TileId{4, 1, -3}}) {
    const TexturedTile tile = model.tile(id);
    const ReadTile read = readGlb(writeGlb(tile, model.grid, {}), "tile.glb");
    EXPECT_EQ(shapeOf(read.tile.surface.mesh), shapeOf(tile.surface.mesh)) << id.level;
    EXPECT_EQ(read.tile.surface.tile, id);
    EXPECT_EQ(read.tile.surface.error, tile.surface.error);
    EXPECT_EQ(read.tile.texel, tile.texel);
    EXPECT_EQ(read.grid.voxel, model.grid.voxel);
  }
}

TEST(Glb, AttributesComeBackWithinTheirSteps) {
  const SyntheticModel model;
  const TexturedTile tile = model.tile({1, 2, 3});
  const ReadTile read = readGlb(writeGlb(tile, model.grid, {}), "tile.glb");
  const Mesh &before = tile.surface.mesh, &after = read.tile.surface.mesh;
  const auto places = byPlace(before);
  ASSERT_EQ(after.vertices.size(), before.vertices.size());
  for (std::size_t k = 0; k < after.vertices.size(); ++k) {
    const std::size_t was = places.at({after.vertices[k].x(), after.vertices[k].y(), after.vertices[k].z()});
    const double angle = std::acos(std::min(1.0F, after.normals[k].dot(before.normals[was])));
    EXPECT_LT(angle, 0.2 * 3.14159 / 180);
    EXPECT_LT((after.texture_coordinates[k] - before.texture_coordinates[was]).cwiseAbs().maxCoeff(),
              0.13F / static_cast<float>(model.texels));
    EXPECT_NEAR(after.sigma[k], before.sigma[was], 0.00013);
    EXPECT_EQ(read.tile.surface.views[k], tile.surface.views[was]);
    EXPECT_EQ(read.tile.surface.shared[k], tile.surface.shared[was]);
  }
}

TEST(Glb, ColoursAtVerticesComeBackExactly) {
  SyntheticModel model{.texels = 0};
  const TexturedTile tile = model.tile({0, -1, 5});
  const ReadTile read = readGlb(writeGlb(tile, model.grid, {}), "tile.glb");
  const auto places = byPlace(tile.surface.mesh);
  const Mesh& after = read.tile.surface.mesh;
  ASSERT_EQ(after.colours.size(), after.vertices.size());
  for (std::size_t k = 0; k < after.vertices.size(); ++k)
    EXPECT_EQ(after.colours[k],
              tile.surface.mesh
                  .colours[places.at({after.vertices[k].x(), after.vertices[k].y(), after.vertices[k].z()})]);
}

TEST(Glb, VerticesOnTheBorderAreEqualInNeighboursAndInTheirParent) {
  const SyntheticModel model;
  const auto border = [&](const TileId& id, std::uint8_t side) {
    const ReadTile read = readGlb(writeGlb(model.tile(id), model.grid, {}), "tile.glb");
    std::set<Corner> places;
    for (std::size_t k = 0; k < read.tile.surface.mesh.vertices.size(); ++k)
      if (const Eigen::Vector3f& v = read.tile.surface.mesh.vertices[k]; read.tile.surface.shared[k] & side)
        places.insert({v.x(), v.y(), v.z()});
    return places;
  };
  const std::set<Corner> leaf = border({0, 3, 0}, kHighNorth);
  EXPECT_EQ(leaf.size(), SyntheticModel::kCells + 1U);
  EXPECT_EQ(leaf, border({0, 4, 0}, kLowNorth));
  const std::set<Corner> parent = border({1, 0, 0}, kHighNorth);
  EXPECT_TRUE(std::includes(parent.begin(), parent.end(), leaf.begin(), leaf.end()));
}

TEST(Glb, SeamsDoubleVerticesAndNotThePlacesThatConnectTheSurface) {
  const SyntheticModel model;
  TexturedTile tile = model.tile({0, 0, 0});
  Mesh& mesh = tile.surface.mesh;
  // Every second triangle gets corners of its own, elsewhere in the atlas.
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 2)
    for (std::uint32_t& corner : mesh.triangles[t]) {
      mesh.vertices.push_back(mesh.vertices[corner]);
      mesh.normals.push_back(mesh.normals[corner]);
      mesh.sigma.push_back(mesh.sigma[corner]);
      mesh.texture_coordinates.emplace_back(mesh.texture_coordinates[corner] * 0.5F);
      tile.surface.shared.push_back(tile.surface.shared[corner]);
      tile.surface.views.push_back(tile.surface.views[corner]);
      corner = static_cast<std::uint32_t>(mesh.vertices.size() - 1);
    }
  const ReadTile read = readGlb(writeGlb(tile, model.grid, {}), "tile.glb");
  EXPECT_EQ(shapeOf(read.tile.surface.mesh), shapeOf(mesh));
  EXPECT_EQ(byPlace(read.tile.surface.mesh).size(), byPlace(mesh).size());
}

TEST(Glb, SurfacesThatBranchTouchAndTurnOverComeBackTriangleByTriangle) {
  const SyntheticModel model;
  std::mt19937 random(3);
  for (int trial = 0; trial < 20; ++trial) {
    TexturedTile tile;
    Mesh& mesh = tile.surface.mesh;
    for (int k = 0; k < 40; ++k) {  // few places for many triangles
      const auto place = [&] {
        return static_cast<float>(static_cast<double>(random() % 4000) * TileGrid::kLattice);
      };
      mesh.vertices.emplace_back(place(), place(), 20 + place());
      mesh.normals.push_back(Eigen::Vector3f(place(), place(), -1).normalized());
    }
    std::set<std::array<std::uint32_t, 3>> chosen;
    for (int t = 0; t < 150; ++t) {
      std::array<std::uint32_t, 3> corners{};
      for (std::uint32_t& corner : corners) corner = static_cast<std::uint32_t>(random() % 40);
      if (corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0])
        chosen.insert(corners);
    }
    mesh.triangles.assign(chosen.begin(), chosen.end());
    const ReadTile read = readGlb(writeGlb(tile, model.grid, {}), "tile.glb");
    ASSERT_EQ(shapeOf(read.tile.surface.mesh), shapeOf(mesh)) << trial;
  }
}

TEST(Glb, PictureIsJpegOrWebpAndCloseToTheAtlas) {
  SyntheticModel model{.texels = 256};
  const TexturedTile tile = model.tile({0, 0, 0});
  for (const PictureFormat format : {PictureFormat::kJpeg, PictureFormat::kWebp}) {
    GlbConfig config;
    config.picture.format = format;
    config.picture.quality = 90;
    GlbFacts facts;
    const std::vector<std::uint8_t> bytes = writeGlb(tile, model.grid, config, &facts);
    EXPECT_EQ(facts.total_bytes, bytes.size());
    const ReadTile read = readGlb(bytes, "tile.glb");
    EXPECT_EQ(formatOf(read.picture), format);
    EXPECT_EQ(read.picture.size(), facts.picture_bytes);
    EXPECT_GT(psnr(read.tile.atlas, tile.atlas), 33);
  }
  GlbConfig none;
  none.picture.format = PictureFormat::kNone;
  none.gpu_texture = "0_0.ktx2";
  const ReadTile read = readGlb(writeGlb(tile, model.grid, none), "tile.glb");
  EXPECT_TRUE(read.picture.empty());
  EXPECT_FALSE(read.tile.surface.mesh.texture_coordinates.empty());
}

TEST(Glb, SameTileGivesTheSameBytes) {
  const SyntheticModel model;
  EXPECT_EQ(writeGlb(model.tile({1, 0, 0}), model.grid, {}), writeGlb(model.tile({1, 0, 0}), model.grid, {}));
}

TEST(Glb, RefusesWhatCannotBeKept) {
  const SyntheticModel model;
  TexturedTile tile = model.tile({0, 0, 0});
  tile.surface.mesh.vertices[5].x() += 0.0001F;
  EXPECT_THROW((void)writeGlb(tile, model.grid, {}), std::invalid_argument);
  EXPECT_THROW((void)writeGlb({}, model.grid, {}), std::invalid_argument);
}

TEST(Glb, DamageAnywhereIsAnInputErrorOrAWholeTile) {
  const SyntheticModel model;
  const std::vector<std::uint8_t> good = writeGlb(model.tile({0, 0, 0}), model.grid, {});
  for (std::size_t length = 0; length < good.size(); length += 97)
    EXPECT_THROW((void)readGlb(std::span(good).first(length), "cut.glb"), InputError) << length;
  int refused = 0;
  for (std::size_t at = 0; at < good.size(); at += 41) {
    std::vector<std::uint8_t> bad = good;
    bad[at] = static_cast<std::uint8_t>(bad[at] ^ 0x55U);
    try {
      const ReadTile read = readGlb(bad, "bad.glb");
      for (const auto& t : read.tile.surface.mesh.triangles)
        for (const std::uint32_t k : t) ASSERT_LT(k, read.tile.surface.mesh.vertices.size());
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 10);
}

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
