#include <gmock/gmock.h>

#include <array>
#include <vector>

#include "recon/topside/report/overlap_colours.hpp"
#include "recon/topside/report/pose_output.hpp"
#include "recon/topside/report/slam_report.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::topside {
namespace {

Mesh square(float north, float east, float size, float depth) {
  Mesh mesh;
  for (const float n : {north, north + size})
    for (const float e : {east, east + size}) mesh.vertices.emplace_back(n, e, depth);
  mesh.triangles = {{0, 1, 3}, {0, 3, 2}};
  mesh.colours.assign(4, Rgb{200, 100, 50});
  computeNormals(mesh);
  return mesh;
}

void append(Mesh& to, const Mesh& from) {
  const auto offset = static_cast<std::uint32_t>(to.vertices.size());
  to.vertices.insert(to.vertices.end(), from.vertices.begin(), from.vertices.end());
  to.normals.insert(to.normals.end(), from.normals.begin(), from.normals.end());
  to.colours.insert(to.colours.end(), from.colours.begin(), from.colours.end());
  for (const auto& [a, b, c] : from.triangles) to.triangles.push_back({a + offset, b + offset, c + offset});
}

// The mesh in two parts.
MapPicture drawn(const Mesh& mesh, int max_pixels, double min_metres) {
  MapExtent extent;
  extent.add(mesh);
  MapPainter painter(extent, max_pixels, min_metres);
  Mesh part = mesh;
  const auto middle = mesh.triangles.begin() + static_cast<std::ptrdiff_t>(mesh.triangles.size() / 2);
  part.triangles.assign(mesh.triangles.begin(), middle);
  painter.add(part);
  part.triangles.assign(middle, mesh.triangles.end());
  painter.add(part);
  return painter.take();
}

TEST(MapPicture, NorthIsUpEastIsRightAndTheUpperSurfaceIsSeen) {
  Mesh mesh = square(0, 0, 1, 10);   // south-west
  append(mesh, square(1, 1, 1, 5));  // north-east, shallower
  append(mesh, square(1, 1, 1, 9));  // hidden below it
  const MapPicture picture = drawn(mesh, 100, 0.001);
  ASSERT_EQ(picture.width, 100);
  ASSERT_EQ(picture.height, 100);
  const auto at = [&](int row, int column) {
    return &picture.rgb[static_cast<std::size_t>(row * 100 + column) * 3];
  };
  EXPECT_EQ(at(25, 25)[0], 255);  // nothing there: background
  EXPECT_EQ(at(75, 75)[0], 255);
  const auto brightness = [&](const std::uint8_t* p) { return p[0] + p[1] + p[2]; };
  EXPECT_GT(brightness(at(25, 75)), brightness(at(75, 25)) + 100);  // shallow is light
  EXPECT_NEAR(picture.rgb_texture[(25 * 100 + 75) * 3], 200, 3);
  EXPECT_EQ(toPng(picture.rgb, picture.width, picture.height).substr(1, 3), "PNG");
  EXPECT_TRUE(drawn(Mesh{}, 100, 0.01).rgb.empty());
}

TEST(Crossovers, OnlyComingBackLaterIsACrossover) {
  std::vector<FusedPair> pairs(4);
  const std::array<double, 4> seconds = {0, 10, 100, 200}, north = {0, 0.5, 0.2, 50};
  for (std::size_t k = 0; k < 4; ++k) {
    pairs[k].pair.utc_ns = static_cast<std::int64_t>(seconds[k] * 1e9);
    pairs[k].T_nav_cam = SE3(Eigen::Quaterniond::Identity(), {north[k], 0, 0});
    pairs[k].footprint_radius = 0.7;
  }
  EXPECT_EQ(likelyCrossovers(pairs), (std::vector<bool>{true, true, true, false}));
  pairs.erase(pairs.begin() + 2);
  EXPECT_EQ(likelyCrossovers(pairs), (std::vector<bool>{false, false, false}));
}

TEST(PoseOutput, NamesInTablesAreOneField) {
  const test::TemporaryFolder folder;
  slam::NavigationLink link;
  link.a = 0, link.b = 1;
  writeClosures(folder.path() / "closures.csv", {{0, "left/a, 1.png", ""}, {1, "left/\"b\".png", ""}},
                {link});
  EXPECT_THAT(test::readText(folder.path() / "closures.csv"),
              ::testing::HasSubstr("\n\"left/a, 1.png\",\"left/\"\"b\"\".png\",0.00000"));
}

TEST(SlamWarnings, TellThatCrossingsWereNotVerifiedAndThatTheSolverDidNotConverge) {
  SlamResult slam;
  slam.crossings_expected = 400;
  slam.crossings_unverified = 30;  // what chance leaves
  EXPECT_TRUE(slamWarnings(slam).empty());
  slam.crossings_unverified = 380;
  ASSERT_EQ(slamWarnings(slam).size(), 1U);
  EXPECT_THAT(slamWarnings(slam)[0], ::testing::HasSubstr("380 m of the 400 m"));
  slam.converged = false;
  EXPECT_EQ(slamWarnings(slam).size(), 2U);
  EXPECT_EQ(web::jsonOf(slamFields(slam)).at("warnings").size(), 2U);
  slam.mounting.camera_turn.y() = -0.05;
  slam.mounting.camera_turn_sigma.y() = 0.002;
  ASSERT_EQ(slamWarnings(slam).size(), 3U);
  EXPECT_THAT(slamWarnings(slam)[2],
              ::testing::HasSubstr("pitch by -2.86 (standard deviation 0.11) degrees"));
  slam.mounting.camera_turn_sigma.y() = 0.02;
  EXPECT_EQ(slamWarnings(slam).size(), 2U) << "it may be chance";
}

}  // namespace
}  // namespace fathom::topside
