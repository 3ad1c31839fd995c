#include "sim/picture/picture.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/ply.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::sim {
namespace {

// Two squares of 2 m side by side: the western one at 5 m, the eastern one at 6 m depth.
Mesh steps() {
  Mesh mesh;
  for (int i = 0; i < 2; ++i) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    const float east = 2.0F * static_cast<float>(i), depth = 5.0F + static_cast<float>(i);
    mesh.vertices.insert(
        mesh.vertices.end(),
        {{100, east, depth}, {100, east + 2, depth}, {102, east + 2, depth}, {102, east, depth}});
    mesh.triangles.push_back({first, first + 1, first + 2});
    mesh.triangles.push_back({first, first + 2, first + 3});
  }
  return mesh;
}

cv::Mat draw(const Mesh& mesh, const PictureOptions& options) {
  const test::TemporaryFolder folder;
  writePly(folder.path() / "mesh.ply", mesh);
  drawPicture(folder.path() / "mesh.ply", folder.path() / "picture.png", options);
  return cv::imread(folder.path() / "picture.png");
}

TEST(Picture, ATopViewShowsColoursWhereTheyAreWithEastToTheRight) {
  Mesh mesh = steps();
  mesh.colours.assign(4, Rgb{200, 20, 20});
  mesh.colours.insert(mesh.colours.end(), 4, Rgb{20, 20, 200});
  const cv::Mat picture = draw(mesh, {PictureOptions::View::kTop, 320, 200});
  ASSERT_EQ(picture.cols, 320);
  ASSERT_EQ(picture.rows, 200);
  const auto west = picture.at<cv::Vec3b>(80, 80), east = picture.at<cv::Vec3b>(80, 240),
             outside = picture.at<cv::Vec3b>(5, 160);
  EXPECT_GT(west[2], 2 * west[0]);
  EXPECT_GT(east[0], 2 * east[2]);
  EXPECT_GT(outside[1], 220);
}

TEST(Picture, AMeshWithoutColoursIsColouredByDepthWithALegend) {
  const cv::Mat picture = draw(steps(), {PictureOptions::View::kTop, 320, 200});
  const auto shallow = picture.at<cv::Vec3b>(80, 60), deep = picture.at<cv::Vec3b>(80, 200);
  EXPECT_GT(shallow[1], deep[1] + 60);  // bright yellow against dark violet
  const int bar = 320 - 45 * 3 / 4 + 3;
  EXPECT_GT(picture.at<cv::Vec3b>(40, bar)[1], picture.at<cv::Vec3b>(160, bar)[1] + 60);
}

TEST(Picture, AnObliqueViewShowsTheWholeMeshInsideTheFrame) {
  const cv::Mat picture = draw(steps(), {PictureOptions::View::kOblique, 320, 200});
  int drawn = 0;
  for (int y = 0; y < 170; ++y)
    for (int x = 0; x < 270; ++x) drawn += picture.at<cv::Vec3b>(y, x)[0] < 200;
  EXPECT_GT(drawn, 6000);
  for (int x = 0; x < 320; ++x) EXPECT_GT(picture.at<cv::Vec3b>(0, x)[1], 200);
}

TEST(Picture, WhatCannotBeDrawnIsRefusedAndLeavesNoFile) {
  const test::TemporaryFolder folder;
  const auto png = folder.path() / "picture.png";
  EXPECT_THROW(drawPicture(folder.path() / "absent.ply", png, {}), InputError);
  Mesh points = steps();
  points.triangles.clear();
  writePly(folder.path() / "points.ply", points);
  EXPECT_THROW(drawPicture(folder.path() / "points.ply", png, {}), InputError);
  writePly(folder.path() / "mesh.ply", steps());
  EXPECT_THROW(drawPicture(folder.path() / "mesh.ply", png, {PictureOptions::View::kTop, 10, 10}),
               InputError);
  EXPECT_FALSE(std::filesystem::exists(png));
}

}  // namespace
}  // namespace fathom::sim
