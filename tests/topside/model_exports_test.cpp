#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <map>
#include <nlohmann/json.hpp>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/compare/plane_frame.hpp"
#include "recon/geometry/ply_reader.hpp"
#include "recon/products/exports/model_glb.hpp"
#include "recon/products/exports/model_las.hpp"
#include "recon/products/exports/results_files.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/tiles/synthetic_model.hpp"

namespace fathom::topside {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

// Nine tiles about the origin on disk: the last one with colours at its vertices instead of a picture.
class TileFolder : public ::testing::Test {
 protected:
  TileFolder() {
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y) {
        const TileId id{0, x, y};
        synthetic::SyntheticModel model;
        if (tiles_.size() == 8) model.texels = 0;
        GlbConfig config;
        config.gpu_texture = "beside.ktx2";
        tiles_.push_back(id);
        glbs_.push_back(writeGlb(model.tile(id), model.grid, config));
        fathom::test::writeBytes(folder_.path() / tilePath(id), glbs_.back());
      }
  }
  static std::uint32_t word(const std::vector<std::uint8_t>& bytes, std::size_t at) {
    std::uint32_t value = 0;
    std::memcpy(&value, &bytes.at(at), sizeof value);
    return value;
  }
  struct Glb {
    Json json;
    std::vector<std::uint8_t> binary;
    explicit Glb(const std::vector<std::uint8_t>& bytes)
        : json(Json::parse(bytes.begin() + 20, bytes.begin() + 20 + word(bytes, 12))),
          binary(bytes.begin() + 28 + word(bytes, 12), bytes.end()) {
      EXPECT_EQ(word(bytes, 8), bytes.size());
      EXPECT_EQ(word(bytes, 20 + word(bytes, 12)), binary.size());
    }
    [[nodiscard]] std::vector<std::uint8_t> view(const Json& index) const {
      const Json& view = json.at("bufferViews").at(index.get<std::size_t>());
      const auto at = binary.begin() + view.at("byteOffset").get<std::ptrdiff_t>();
      return {at, at + view.at("byteLength").get<std::ptrdiff_t>()};
    }
    // All that a node leads to.
    [[nodiscard]] Json node(std::size_t k) const {
      const Json& node = json.at("nodes").at(k);
      const Json& primitive = json.at("meshes").at(node.at("mesh").get<std::size_t>()).at("primitives").at(0);
      Json all{{"translation", node.at("translation")}, {"tile", node.at("extras").at("tile")}};
      for (const auto& [name, accessor] : primitive.at("attributes").items())
        all[name] = json.at("accessors").at(accessor.get<std::size_t>());
      all["indices"] = json.at("accessors").at(primitive.at("indices").get<std::size_t>());
      all["surface"] = view(primitive.at("/extensions/KHR_draco_mesh_compression/bufferView"_json_pointer));
      const Json& material = json.at("materials").at(primitive.at("material").get<std::size_t>());
      const auto texture = "/pbrMetallicRoughness/baseColorTexture/index"_json_pointer;
      if (material.contains(texture)) {
        const Json& source = json.at("textures").at(material.at(texture).get<std::size_t>()).at("source");
        all["picture"] = view(json.at("images").at(source.get<std::size_t>()).at("bufferView"));
      }
      return all;
    }
  };

  std::vector<TileId> tiles_;
  std::vector<std::vector<std::uint8_t>> glbs_;
  fathom::test::TemporaryFolder folder_;
};

TEST_F(TileFolder, OneGlbHoldsEveryTileWithItsPictureUnchanged) {
  const auto path = folder_.path() / "model.glb";
  const ModelCounts counts = writeModelGlb(path, folder_.path(), tiles_);
  const std::vector<std::uint8_t> bytes = fathom::test::readBytes(path);
  const Glb joined(bytes);
  ASSERT_EQ(joined.json.at("nodes").size(), 9U);
  EXPECT_EQ(joined.json.at("scenes").at(0).at("nodes").size(), 9U);
  EXPECT_EQ(joined.json.at("textures").size(), 8U);
  std::uint64_t triangles = 0;
  for (std::size_t k = 0; k < 9; ++k) {
    EXPECT_EQ(joined.node(k), Glb(glbs_[k]).node(0)) << k;
    EXPECT_EQ(joined.node(k).contains("picture"), k < 8);
    triangles += readGlb(glbs_[k], "tile").tile.surface.mesh.triangles.size();
  }
  EXPECT_EQ(counts.triangles, triangles);
  EXPECT_THAT(joined.json.dump(), testing::Not(HasSubstr("beside.ktx2")));
  const ReadTile first = readGlb(bytes, "joined"), alone = readGlb(glbs_[0], "tile");
  EXPECT_EQ(first.tile.surface.mesh.vertices, alone.tile.surface.mesh.vertices);
  EXPECT_EQ(first.picture, alone.picture);
}

TEST_F(TileFolder, MoreThanAGlbCanHoldIsRefusedBeforeAnythingIsWritten) {
  // Tiles that claim 3 GiB each.
  const std::uint32_t huge = 3U << 30;
  for (std::size_t k = 0; k < 2; ++k) {
    std::vector<std::uint8_t> bytes = glbs_[k];
    std::memcpy(&bytes[20 + word(bytes, 12)], &huge, sizeof huge);
    fathom::test::writeBytes(folder_.path() / tilePath(tiles_[k]), bytes);
  }
  const auto path = folder_.path() / "model.glb";
  try {
    (void)writeModelGlb(path, folder_.path(), {tiles_[0], tiles_[1]});
    FAIL() << "6 GiB in one GLB";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("a GLB holds 4096"));
  }
  EXPECT_THROW((void)writeModelGlb(path, folder_.path(), {tiles_[0]}), InputError);  // cut off
  EXPECT_FALSE(std::filesystem::exists(path));
  fathom::test::writeText(folder_.path() / tilePath(tiles_[0]), "no tile");
  EXPECT_THROW((void)writeModelGlb(path, folder_.path(), {tiles_[0]}), InputError);
}

template <typename Number>
Number at(const std::vector<std::uint8_t>& bytes, std::size_t place) {
  Number value{};
  std::memcpy(&value, &bytes.at(place), sizeof value);
  return value;
}

TEST_F(TileFolder, LasHoldsTheVerticesInUtmWithTheirColours) {
  const Geodetic origin{-0.7, 2.571};  // 40.1 S, 147.3 E
  EXPECT_EQ(utmOf(origin), "EPSG:32755");
  const auto path = folder_.path() / "model.las";
  const ModelCounts counts =
      writeModelLas(path, tiles_, glbSource(folder_.path()), compare::localFrame(origin), "EPSG:32755");
  (void)writeModelPly(folder_.path() / "model.ply", tiles_, glbSource(folder_.path()));
  const Mesh mesh = readPly(folder_.path() / "model.ply");
  const std::vector<std::uint8_t> las = fathom::test::readBytes(path);
  const auto first = at<std::uint32_t>(las, 96);
  EXPECT_EQ(std::string(las.begin(), las.begin() + 4), "LASF");
  EXPECT_EQ(at<std::uint16_t>(las, 94), 375);  // bytes of the header
  EXPECT_EQ(las[104], 7);                      // format of its points
  EXPECT_EQ(at<std::uint16_t>(las, 6) & 0x10, 0x10);
  ASSERT_EQ(at<std::uint64_t>(las, 247), mesh.vertices.size());
  ASSERT_EQ(counts.vertices, mesh.vertices.size());
  ASSERT_EQ(las.size(), first + 36 * mesh.vertices.size());
  EXPECT_THAT(std::string(las.begin() + 375 + 54, las.begin() + first), HasSubstr("UTM zone 55S"));

  const LocalTransverseMercator local(origin);
  const compare::PlaneTransform utm(compare::frameFrom("EPSG:4326", ""),
                                    compare::frameFrom("EPSG:32755", ""));
  const auto number = [&](std::size_t place) { return at<double>(las, place); };
  for (std::size_t k = 0; k < mesh.vertices.size(); k += 97) {
    const std::size_t point = first + 36 * k;
    const auto coordinate = [&](std::size_t axis) {
      return number(155 + 8 * axis) + number(131 + 8 * axis) * at<std::int32_t>(las, point + 4 * axis);
    };
    const Eigen::Vector3d place = mesh.vertices[k].cast<double>();
    const Geodetic geodetic = local.toGeodetic({place.y(), place.x()});
    std::vector<double> x{radiansToDegrees(geodetic.longitude)}, y{radiansToDegrees(geodetic.latitude)};
    utm.apply(x, y);
    EXPECT_NEAR(coordinate(0), x[0], 1e-3);
    EXPECT_NEAR(coordinate(1), y[0], 1e-3);
    EXPECT_NEAR(coordinate(2), place.z(), 1e-3);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_GE(number(179 + 16 * axis) + 1e-9, coordinate(axis));
      EXPECT_LE(number(187 + 16 * axis) - 1e-9, coordinate(axis));
      EXPECT_EQ(at<std::uint16_t>(las, point + 30 + 2 * axis), 257 * mesh.colours[k][axis]);
    }
  }
}

TEST_F(TileFolder, LasOfADiveWithoutAPlaceHasItsOwnMetres) {
  const std::filesystem::path path = folder_.path() / "own.las";
  const ModelCounts counts = writeModelLas(path, tiles_, glbSource(folder_.path()), {}, "");
  const std::string bytes = fathom::test::readText(path);
  EXPECT_THAT(bytes, testing::HasSubstr("LOCAL_CS[\"the dive's own\""));
  std::array<double, 6> extent{};  // largest and least x, y, z
  std::memcpy(extent.data(), &bytes[179], sizeof extent);
  Eigen::Vector2d low(1e9, 1e9), high = -low;  // east, north
  for (const TileId& id : tiles_)
    for (const Eigen::Vector3f& v : glbSource(folder_.path())(id).tile.surface.mesh.vertices) {
      low = low.cwiseMin(Eigen::Vector2d(v.y(), v.x()));
      high = high.cwiseMax(Eigen::Vector2d(v.y(), v.x()));
    }
  EXPECT_NEAR(extent[0] - extent[1], high.x() - low.x(), 1e-3) << "no scale of a projection";
  EXPECT_NEAR(extent[2] - extent[3], high.y() - low.y(), 1e-3);
  EXPECT_GT(counts.vertices, 0u);
}

TEST_F(TileFolder, LasInDegreesOrInNoSystemIsRefused) {
  const auto path = folder_.path() / "model.las";
  for (const char* crs : {"EPSG:4326", "utm 55"})
    EXPECT_THROW((void)writeModelLas(path, tiles_, glbSource(folder_.path()), {}, crs), InputError) << crs;
  EXPECT_FALSE(std::filesystem::exists(path));
}

}  // namespace
}  // namespace fathom::topside
