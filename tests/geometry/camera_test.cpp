#include "recon/geometry/camera.hpp"

#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

namespace fathom {
namespace {

Camera surveyCamera() {
  return {1360, 1024, 1710.0, 1708.0, 690.0, 499.0, 0.136, 0.734, 0.005, 0.002, -0.3};
}

TEST(Camera, ProjectsAsOpenCvDoes) {
  const Camera c = surveyCamera();
  const cv::Matx33d k(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
  const std::vector<double> distortion = {c.k1, c.k2, c.p1, c.p2, c.k3};
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0.3, -0.2, 2.0), Eigen::Vector3d(-0.7, 0.5, 1.9)}) {
    std::vector<cv::Point2d> projected;
    cv::projectPoints(std::vector<cv::Point3d>{{p.x(), p.y(), p.z()}}, cv::Vec3d(), cv::Vec3d(), k,
                      distortion, projected);
    const Eigen::Vector2d pixel = c.project(p);
    EXPECT_NEAR(pixel.x(), projected[0].x, 1e-9);
    EXPECT_NEAR(pixel.y(), projected[0].y, 1e-9);
  }
}

TEST(Camera, UndistortionInvertsDistortionOverTheWholeImage) {
  const Camera c = surveyCamera();
  for (int v = 0; v < c.height; v += 93) {
    for (int u = 0; u < c.width; u += 97) {
      const Eigen::Vector2d pixel(u, v);
      EXPECT_LT((c.project(c.ray(pixel) * 2.3) - pixel).norm(), 1e-7) << u << ", " << v;
    }
  }
}

TEST(Camera, ScalingKeepsTheViewOfPixelAreas) {
  const Camera c = surveyCamera();
  const Camera half = c.scaled(0.5);
  EXPECT_EQ(half.width, 680);
  EXPECT_EQ(half.height, 512);
  // Pixel (0, 0) of the half-size image covers pixels (0..1, 0..1): its centre is at (0.5, 0.5).
  EXPECT_LT((half.undistort({0, 0}) - c.undistort({0.5, 0.5})).norm(), 1e-9);
  EXPECT_LT((half.undistort({679, 511}) - c.undistort({1358.5, 1022.5})).norm(), 1e-9);
}

TEST(Camera, ContainsHonoursTheMargin) {
  const Camera c = surveyCamera();
  EXPECT_TRUE(c.contains({0, 0}));
  EXPECT_FALSE(c.contains({0, 0}, 1));
  EXPECT_FALSE(c.contains({1359.5, 10}));
}

}  // namespace
}  // namespace fathom
