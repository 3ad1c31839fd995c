#include <gmock/gmock.h>

#include <cstring>
#include <map>
#include <nlohmann/json.hpp>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/compare/plane_frame.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/products/exports/model_glb.hpp"
#include "recon/products/exports/results_files.hpp"
#include "recon/products/exports/sparse_model.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/colmap_files.hpp"
#include "tests/world/tiles.hpp"

namespace fathom::topside {
namespace {

using ::testing::HasSubstr, ::testing::UnorderedElementsAre;
using Json = nlohmann::json;

// Nine tiles about the origin on disk: the last one with colours at its vertices instead of a picture.
class TileFolder : public ::testing::Test {
 protected:
  TileFolder() {
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y) {
        const TileId id{0, x, y};
        test::SyntheticModel model;
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

// Views half a metre apart that look down at the same places 2 m below, whose pixels are exact.
class SparseDive : public ::testing::Test {
 protected:
  SparseDive() {
    const Camera left{680, 512, 850, 860, 340.2, 255.1, -0.11, 0.07, 0.001, -0.002, 0},
        right{680, 512, 845, 855, 338.7, 250.3, -0.12, 0.09, 0.002, 0.001, 0};
    model_.rig = {left, right, SE3::fromEuler(0.01, -0.02, 0.005, {-0.07, 0.001, 0.002})};
    model_.origin = {-0.4, 2.5};
    model_.placed_by = "gps";
    for (int v = 0; v < 3; ++v) {
      const SE3 T_nav_cam = SE3::fromEuler(0.02, 0.03, 0.4, {0.1 * v, -0.2, 8});
      StereoView view{"day/left " + std::to_string(v) + ".tif",
                      "day/right " + std::to_string(v) + ".tif",
                      worldFromNav() * T_nav_cam,
                      {},
                      {}};
      for (const Eigen::Vector3d& place : places_)
        view.features.push_back(seen(view.T_world_cam, worldFromNav() * place));
      model_.views.push_back(view);
    }
  }
  [[nodiscard]] closure::Feature seen(const SE3& T_world_cam, const Eigen::Vector3d& place) const {
    const Eigen::Vector3d left = T_world_cam.inverse() * place;
    return {model_.rig.left.project(left).cast<float>(),
            model_.rig.right.project(model_.rig.T_right_left * left).cast<float>(),
            left.cast<float>(),
            {1e-6F, 0, 0, 1e-6F, 0, 1e-5F},
            9};
  }
  static ViewMatches all(std::uint32_t a, std::uint32_t b) { return {a, b, {{0, 0}, {1, 1}, {2, 2}}}; }
  [[nodiscard]] std::vector<std::uint32_t> viewsOfPoints() const {
    std::vector<std::uint32_t> views;
    for (const SparsePoint& point : model_.points) views.push_back(point.views);
    return views;
  }

  std::vector<Eigen::Vector3d> places_{{0.1, -0.1, 10}, {0.3, -0.3, 10.2}, {-0.1, 0.05, 9.8}};  // in nav
  SparseModel model_;
  test::TemporaryFolder folder_;
};

TEST_F(SparseDive, FeaturesThatMatchesJoinAreOnePointSeenByAllTheirViews) {
  joinFeatures({all(0, 1), all(1, 2)}, model_);
  ASSERT_EQ(model_.points.size(), 3U);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(model_.points[k].views, 3U);
    EXPECT_LT((model_.points[k].place - worldFromNav() * places_[k]).norm(), 1e-6);
    for (std::uint32_t v = 0; v < 3; ++v) EXPECT_EQ(model_.views[v].point_of[k], k);
  }
  EXPECT_LT(model_.meanError(), 1e-3);
}

TEST_F(SparseDive, AMatchThatPutsTwoFeaturesOfOneViewInOnePointIsRejected) {
  joinFeatures({all(0, 1), {1, 2, {{0, 0}, {1, 2}}}, {0, 2, {{1, 1}}}}, model_);
  // Feature 1 of view 0 leads to features 1 and 2 of view 2.
  EXPECT_THAT(viewsOfPoints(), UnorderedElementsAre(3, 1, 1, 1, 1, 2));
  EXPECT_LT(model_.meanError(), 1e-3);
}

TEST_F(SparseDive, AViewWhosePixelsDoNotFitIsLeftOutOfAPoint) {
  closure::Feature& off = model_.views[2].features[1];
  off = seen(model_.views[2].T_world_cam, worldFromNav() * (places_[1] + Eigen::Vector3d(0.1, 0, 0)));
  off.covariance = {1e-4F, 0, 0, 1e-4F, 0, 1e-3F};
  joinFeatures({all(0, 1), all(1, 2)}, model_);
  EXPECT_THAT(viewsOfPoints(), UnorderedElementsAre(3, 3, 2, 1));
  EXPECT_LT(model_.meanError(), 1e-3);
}

TEST_F(SparseDive, ColmapFindsEveryPixelWhereItsOwnCameraModelProjectsThePoint) {
  for (const double k3 : {0.0, -0.03}) {
    model_.rig.right.k3 = k3;
    for (StereoView& view : model_.views)
      for (std::size_t k = 0; k < 3; ++k)
        view.features[k] = seen(view.T_world_cam, worldFromNav() * places_[k]);
    model_.points.clear();
    model_.members.clear();
    joinFeatures({all(0, 1)}, model_);
    writeColmapModel(folder_.path() / "sparse", model_, ColmapFormat::kBinary);
    const test::ColmapFiles read(folder_.path() / "sparse");
    ASSERT_EQ(read.cameras.size(), 2U);
    EXPECT_EQ(read.cameras.at(1).model, 4);
    EXPECT_EQ(read.cameras.at(2).model, k3 == 0 ? 4 : 6);
    EXPECT_DOUBLE_EQ(read.cameras.at(1).p[2], 340.7);  // the top left pixel's centre is (0.5, 0.5)
    ASSERT_EQ(read.images.size(), 6U);
    EXPECT_EQ(read.images.at(4).name, "day/right 1.tif");
    ASSERT_EQ(read.points.size(), 6U);
    for (const auto& [id, point] : read.points) {
      EXPECT_LT(read.errorOf(point), 1e-3);
      for (const auto& [image, k] : point.track) EXPECT_EQ(read.images.at(image).points.at(k), id);
    }
    EXPECT_LT((read.points.at(1).place - Eigen::Vector3d(-0.1, 0.1, -10)).norm(), 1e-6);  // east, north, up
  }
  EXPECT_THAT(test::readText(folder_.path() / "sparse" / "origin.txt"), HasSubstr("latitude -22.918"));
}

TEST_F(SparseDive, ColmapsTextSaysTheSame) {
  for (StereoView& view : model_.views) {
    view.left = "l" + std::to_string(&view - model_.views.data()) + ".tif";
    view.right[view.right.find(' ')] = '_';
  }
  joinFeatures({all(0, 1), all(1, 2)}, model_);
  writeColmapModel(folder_.path() / "sparse", model_, ColmapFormat::kText);
  const std::string cameras = test::readText(folder_.path() / "sparse" / "cameras.txt");
  EXPECT_THAT(cameras, HasSubstr("1 OPENCV 680 512 850 860 340.69999999999999 "));
  std::istringstream images(test::readText(folder_.path() / "sparse" / "images.txt"));
  std::string line, pixels;
  int rows = 0;
  for (; std::getline(images, line) && std::getline(images, pixels); ++rows) {
    std::istringstream words(line), numbers(pixels);
    int id = 0, camera = 0, count = 0;
    double value = 0;
    words >> id;
    for (int k = 0; k < 7; ++k) words >> value;
    std::string name;
    words >> camera >> name;
    EXPECT_EQ(id, rows + 1);
    EXPECT_EQ(camera, rows % 2 + 1);
    EXPECT_THAT(name, HasSubstr(".tif"));
    while (numbers >> value) ++count;
    EXPECT_EQ(count, 9);
  }
  EXPECT_EQ(rows, 6);
  const std::string points = test::readText(folder_.path() / "sparse" / "points3D.txt");
  EXPECT_EQ(points.substr(0, 2), "1 ");
  EXPECT_THAT(points, HasSubstr(" 128 128 128 "));
  EXPECT_THAT(points, HasSubstr(" 1 0 2 0 3 0 4 0 5 0 6 0\n"));
}

TEST_F(SparseDive, ANameWithASpaceIsRefusedInColmapsTextAndNothingIsLeft) {
  joinFeatures({}, model_);
  EXPECT_THROW(writeColmapModel(folder_.path() / "sparse", model_, ColmapFormat::kText), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(SparseDive, NerfstudioFindsImagesAndPointsWhereTheCamerasLook) {
  joinFeatures({all(0, 1), all(1, 2)}, model_);
  const std::filesystem::path scene = folder_.path() / "scenes" / "reef", images = folder_.path() / "img";
  writeNerfstudioScene(scene, model_, images);
  const auto json = nlohmann::json::parse(test::readText(scene / "transforms.json"));
  ASSERT_EQ(json.at("frames").size(), 6U);
  EXPECT_EQ(json.at("camera_model"), "OPENCV");
  EXPECT_EQ(json.at("frames")[3].at("file_path"), "../../img/day/right 1.tif");
  const Mesh points = readPly(scene / json.at("ply_file_path").get<std::string>());
  ASSERT_EQ(points.vertices.size(), 3U);
  for (std::size_t f = 0; f < 6; ++f) {
    const auto& frame = json.at("frames")[f];
    Eigen::Matrix4d pose;
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 4; ++column)
        pose(row, column) = frame.at("transform_matrix")[row][column];
    EXPECT_NEAR(pose.determinant(), 1, 1e-9);
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector4d seen = pose.inverse() * points.vertices[k].cast<double>().homogeneous();
      const auto number = [&](const char* key) { return frame.at(key).get<double>(); };
      Camera camera{680,          512,          number("fl_x"), number("fl_y"), number("cx"), number("cy"),
                    number("k1"), number("k2"), number("p1"),   number("p2"),   number("k3")};
      // OpenGL's axes: in front is -z, up is y.
      const Eigen::Vector2d pixel = camera.project({seen.x(), -seen.y(), -seen.z()});
      const closure::Feature& feature = model_.views[f / 2].features[k];
      const Eigen::Vector2f measured = f % 2 == 0 ? feature.left : feature.right;
      EXPECT_LT((pixel - measured.cast<double>() - Eigen::Vector2d(0.5, 0.5)).norm(), 2e-3);
    }
  }
}

TEST_F(SparseDive, NerfstudioFindsImagesFromAFolderThatIsNotThereYet) {
  joinFeatures({}, model_);
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::create_directories(folder_.path() / "img");
  std::filesystem::current_path(folder_.path());
  writeNerfstudioScene("new/scene", model_, "img");
  std::filesystem::current_path(before);
  const auto json = nlohmann::json::parse(test::readText(folder_.path() / "new/scene/transforms.json"));
  EXPECT_EQ(json.at("frames")[3].at("file_path"), "../../img/day/right 1.tif");
}

TEST_F(SparseDive, AFolderWithForeignFilesIsLeftAsItIs) {
  joinFeatures({}, model_);
  test::writeText(folder_.path() / "thesis.txt", "years of work");
  EXPECT_THROW(writeColmapModel(folder_.path(), model_, ColmapFormat::kBinary), InputError);
  EXPECT_THROW(writeNerfstudioScene(folder_.path(), model_, "img"), InputError);
  EXPECT_EQ(test::readText(folder_.path() / "thesis.txt"), "years of work");
}

}  // namespace
}  // namespace fathom::topside
