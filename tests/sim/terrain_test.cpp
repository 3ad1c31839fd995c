#include "sim/sea/sea_terrain.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/ply.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::sim {
namespace {

TerrainConfig flatConfig() {
  TerrainConfig config;
  config.size_north_m = config.size_east_m = 6.0;
  config.grid_spacing_m = 0.05;
  config.base_depth_m = 20.0;
  config.undulation_m = config.roughness_m = 0.0;
  config.ripples.height_m = 0.0;
  config.rubble.density_per_m2 = config.boulders.density_per_m2 = config.corals.density_per_m2 = 0.0;
  return config;
}

TerrainConfig reefConfig() {
  TerrainConfig config;
  config.size_north_m = config.size_east_m = 5.0;
  config.grid_spacing_m = 0.04;
  config.corals.density_per_m2 = 0.3;
  config.centre_north_m = 40.0;
  config.centre_east_m = -30.0;
  return config;
}

TEST(Terrain, RaysMeetAFlatSeafloorAtTheAnalyticDistance) {
  const SeaTerrain terrain(flatConfig());
  EXPECT_NEAR(terrain.depthAt(0.3, -1.2).value(), 20.0, 1e-5);
  const Eigen::Vector3d origin(0.5, 0.25, 17.0), direction(0.3, -0.2, 2.0);
  const double expected = 3.0 / direction.normalized().z();
  EXPECT_NEAR(terrain.castRay(origin, direction).value(), expected, 1e-5);
  EXPECT_FALSE(terrain.castRay(origin, -direction).has_value());
  EXPECT_FALSE(terrain.depthAt(10.0, 0.0).has_value());
}

TEST(Terrain, NoRayPassesThroughVerticesOrEdges) {
  const SeaTerrain terrain(flatConfig());
  for (int i = -50; i <= 50; ++i)
    for (int j = -50; j <= 50; ++j)
      ASSERT_NEAR(terrain.castRay({0, 0, 18}, {i * 0.05, j * 0.05, 2}).value_or(-1),
                  Eigen::Vector3d(i * 0.05, j * 0.05, 2).norm(), 1e-4);
}

TEST(Terrain, RipplesHaveTheirHeightAndWavelength) {
  TerrainConfig config = flatConfig();
  config.grid_spacing_m = 0.01;
  config.size_north_m = 8.0;
  config.size_east_m = 1.0;
  config.ripples = {0.25, 0.06, 0.0};
  const SeaTerrain terrain(config);
  double lowest = 0, highest = 100;
  int crossings = 0;
  bool was_above = false;
  for (double north = -3.9; north < 3.9; north += 0.005) {
    const double depth = terrain.depthAt(north, 0.0).value();
    lowest = std::max(lowest, depth), highest = std::min(highest, depth);
    const bool above = depth < 20.0;
    crossings += above && !was_above;
    was_above = above;
  }
  EXPECT_NEAR(lowest - highest, 0.06, 0.015);
  EXPECT_NEAR(crossings, 7.8 / 0.25, 5.0);
}

TEST(Terrain, ADropOffFallsByItsHeightAndItsLipOverhangs) {
  TerrainConfig config = flatConfig();
  config.size_north_m = config.size_east_m = 10.0;
  config.ledges = {{0.0, 0.0, std::numbers::pi / 2, 3.0, 0.5, 0.6}};
  const SeaTerrain terrain(config);
  for (double north : {-4.0, 0.0, 4.0}) {
    EXPECT_NEAR(terrain.depthAt(north, -4.0).value(), 20.0, 0.05);
    EXPECT_NEAR(terrain.depthAt(north, 4.0).value(), 23.0, 0.05);
  }
  // Somewhere a ray straight up from in front of the wall meets the underside of the lip.
  int covered = 0;
  for (double north = -4.0; north <= 4.0; north += 0.1)
    for (double east = -2.0; east <= 2.0; east += 0.05)
      covered += terrain.castRay({north, east, 22.0}, {0, 0, -1}).has_value() &&
                 terrain.castRay({north, east, 22.0}, {0, 0, 1}).has_value() &&
                 !terrain.castRay({north, east, 22.0}, {0, 1, 0}).has_value();
  EXPECT_GT(covered, 20);
}

TEST(Terrain, ItsMeshIsTheSurfaceThatRaysHit) {
  const SeaTerrain terrain(reefConfig());
  const Mesh mesh = terrain.mesh();
  ASSERT_EQ(mesh.colours.size(), mesh.vertices.size());
  int seen = 0, agree = 0, from_above = 0, facing_up = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 7) {
    const auto& [a, b, c] = mesh.triangles[i];
    const Eigen::Vector3d p = mesh.vertices[a].cast<double>(), q = mesh.vertices[b].cast<double>(),
                          r = mesh.vertices[c].cast<double>();
    const Eigen::Vector3d centre = (p + q + r) / 3.0, normal = (q - p).cross(r - p).normalized();
    const Eigen::Vector3d start = centre + 0.05 * normal;
    const auto distance = terrain.castRay(start, -normal);
    ASSERT_TRUE(distance.has_value());
    ++seen;
    agree += std::abs(*distance - 0.05) < 2e-5;
    const auto depth = terrain.depthAt(centre.x(), centre.y());
    const bool on_top = depth && std::abs(*depth - centre.z()) < 1e-4;
    from_above += on_top;
    facing_up += on_top && normal.z() < 0;
  }
  ASSERT_GT(seen, 3000);
  EXPECT_GT(agree, 0.85 * seen);  // others are hidden in the corals' grooves
  ASSERT_GT(from_above, 3000);
  EXPECT_EQ(facing_up, from_above);
}

TEST(Terrain, CoralHeadsOverhangTheSeafloor) {
  TerrainConfig config = flatConfig();
  config.corals = {0.5, 0.5, 0.8, 0.5};
  const SeaTerrain terrain(config);
  int overhung = 0;
  for (double north = -2.5; north < 2.5; north += 0.05)
    for (double east = -2.5; east < 2.5; east += 0.05)
      overhung += terrain.castRay({north, east, 19.98}, {0, 0, -1}).has_value() &&
                  terrain.castRay({north, east, 19.98}, {0, 0, 1}).value_or(1.0) < 0.05;
  EXPECT_GT(overhung, 20);
}

TEST(Terrain, TheSameSeedGivesTheSameSurfaceAndAnotherSeedAnother) {
  TerrainConfig config = reefConfig();
  const Mesh once = SeaTerrain(config).mesh();
  const Mesh again = SeaTerrain(config).mesh();
  EXPECT_EQ(once.vertices, again.vertices);
  EXPECT_EQ(once.colours, again.colours);
  EXPECT_EQ(once.triangles, again.triangles);
  config.seed = 2;
  EXPECT_NE(once.vertices, SeaTerrain(config).mesh().vertices);
}

TEST(Terrain, AMeshFileIsCentredWhereTheConfigurationSays) {
  FATHOM_REQUIRE_DATA("pavlopetri/chamber3.ply");
  TerrainConfig config;
  config.kind = TerrainKind::kMesh;
  config.mesh_file = test::dataFile("pavlopetri/chamber3.ply");
  config.centre_north_m = 100.0;
  config.base_depth_m = 4.0;
  const SeaTerrain terrain(config);
  const Eigen::Vector3d size = terrain.upper() - terrain.lower();
  EXPECT_NEAR(size.z(), 2.44, 0.02);
  EXPECT_NEAR(0.5 * (terrain.upper() + terrain.lower()).x(), 100.0, 0.01);
  EXPECT_GT(terrain.depthAt(100.0, 0.0).value(), 2.5);
  EXPECT_LT(terrain.depthAt(100.0, 0.0).value(), 6.0);
}

TEST(Terrain, ItsMeshHasTheTexturesColoursBetweenTheCorners) {
  const test::TemporaryFolder temporary;
  Mesh triangle;
  triangle.vertices = {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}};
  triangle.triangles = {{0, 1, 2}};
  triangle.texture_coordinates = {{0, 0}, {0, 1}, {1, 0}};
  TerrainConfig config;
  config.kind = TerrainKind::kMesh;
  config.mesh_file = temporary.path() / "triangle.ply";
  config.texture_file = temporary.path() / "halves.png";
  writePly(config.mesh_file, triangle);
  cv::Mat halves(64, 64, CV_8UC3, cv::Scalar(40, 40, 40));
  halves.colRange(8, 56).setTo(cv::Scalar(200, 200, 200));
  cv::imwrite(config.texture_file.string(), halves);
  const Mesh mesh = SeaTerrain(config).mesh();
  ASSERT_EQ(mesh.colours.size(), mesh.vertices.size());
  const float north = mesh.vertices[0].x();  // of the corner at s = 0
  int right = 0, seen = 0;
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const float s = mesh.vertices[i].x() - north;
    if (std::abs(s - 0.125F) < 0.03F || std::abs(s - 0.875F) < 0.03F) continue;  // blurred
    ++seen;
    right += std::abs(mesh.colours[i][1] - (s > 0.125F && s < 0.875F ? 200 : 40)) <= 2;
  }
  EXPECT_GT(seen, 2000);
  EXPECT_EQ(right, seen);
}

TEST(Terrain, BadMeshesTexturesAndNumbersAreRefusedWithTheirName) {
  const test::TemporaryFolder temporary;
  const std::filesystem::path& folder = temporary.path();
  TerrainConfig config;
  config.kind = TerrainKind::kMesh;
  config.mesh_file = folder / "absent.ply";
  EXPECT_THROW(SeaTerrain{config}, InputError);
  std::ofstream(folder / "points.ply")
      << "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float "
         "y\nproperty float z\nend_header\n0 0 0\n";
  config.mesh_file = folder / "points.ply";
  EXPECT_THROW(SeaTerrain{config}, InputError);
  Mesh triangle;
  triangle.vertices = {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}};
  triangle.triangles = {{0, 1, 2}};
  writePly(folder / "good.ply", triangle);
  config.mesh_file = folder / "good.ply";
  EXPECT_NO_THROW(SeaTerrain{config});
  config.texture_file = folder / "good.ply";
  EXPECT_THROW(SeaTerrain{config}, InputError);
  triangle.texture_coordinates = {{0, 0}, {0, 1}, {1, 0}};
  writePly(folder / "good.ply", triangle);
  EXPECT_THROW(SeaTerrain{config}, InputError);  // the texture is no image
  TerrainConfig wild;
  wild.grid_spacing_m = std::nan("");
  EXPECT_THROW(SeaTerrain{wild}, std::invalid_argument);
  wild = TerrainConfig();
  wild.corals.overhang = 2.0;
  EXPECT_THROW(SeaTerrain{wild}, std::invalid_argument);
}

// Heights upwards in a text raster that GDAL reads: a slope that rises to the north, one cell without height.
std::filesystem::path slopeRaster(const std::filesystem::path& folder) {
  const auto file = folder / "slope.asc";
  std::ofstream out(file);
  out << "ncols 5\nnrows 5\nxllcorner 0\nyllcorner 0\ncellsize 2\nNODATA_value -9999\n";
  for (int row = 0; row < 5; ++row)
    for (int column = 0; column < 5; ++column)
      out << (row == 2 && column == 2 ? -9999.0 : 10.0 - 0.5 * row) << (column == 4 ? '\n' : ' ');
  return file;
}

TEST(Terrain, ARealReliefIsAddedAtItsSizeOrScaled) {
  const test::TemporaryFolder folder;
  TerrainConfig config = flatConfig();
  config.size_north_m = config.size_east_m = 9;
  config.relief_file = slopeRaster(folder.path());
  const SeaTerrain stated(config);
  constexpr double kMean = 0.006;  // by which the filled hole moves it
  EXPECT_NEAR(stated.depthAt(2.0, 1.0).value(), 20 - 0.5, kMean) << "a cell northwards rises by half a metre";
  EXPECT_NEAR(stated.depthAt(-3.0, -1.0).value(), 20 + 0.75, kMean);
  EXPECT_NEAR(stated.depthAt(0.0, 0.0).value(), 20, 0.15) << "the hole is filled";
  EXPECT_NEAR(stated.depthAt(4.4, 0.0).value(), 20 - 0.9, kMean) << "mirrored at its edge";
  config.relief_cell_m = 0.5;
  EXPECT_NEAR(SeaTerrain(config).depthAt(0.5, 0.0).value(), 20 - 0.125, kMean) << "a quarter of the size";
  const auto letter = folder.path() / "letter.tif";
  std::ofstream(letter) << "dear all";
  config.relief_file = letter;
  EXPECT_THROW(SeaTerrain{config}, InputError);
}

TEST(Terrain, TheTruthHasTheColoursOfThePhotographs) {
  const test::TemporaryFolder folder;
  cv::Mat image(1024, 1360, CV_8UC3);
  cv::theRNG().state = 7;
  cv::randn(image, cv::Scalar(60, 110, 170), cv::Scalar(15, 15, 15));  // blue, green, red
  cv::imwrite((folder.path() / "a.png").string(), image);
  TerrainConfig config = flatConfig();
  config.albedo_images = folder.path();
  const Mesh mesh = SeaTerrain(config).mesh();
  std::array<double, 3> sum{};
  std::set<int> reds;
  for (const Rgb& colour : mesh.colours) {
    for (std::size_t c = 0; c < 3; ++c) sum[c] += colour[c];
    reds.insert(colour[0]);
  }
  const auto count = static_cast<double>(mesh.colours.size());
  EXPECT_NEAR(sum[0] / count, 170, 3);
  EXPECT_NEAR(sum[1] / count, 110, 3);
  EXPECT_NEAR(sum[2] / count, 60, 3);
  EXPECT_GT(reds.size(), 5u) << "with what the footprint of a vertex leaves of their texture";
}

}  // namespace
}  // namespace fathom::sim
