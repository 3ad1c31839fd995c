#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <opencv2/calib3d.hpp>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom {
namespace {

using test::TemporaryFolder, ::testing::HasSubstr;

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

StereoRig surveyRig() {
  const Camera c{1360, 1024, 1710.0, 1708.0, 690.0, 499.0, 0.136, 0.734, 0.005, 0.002, 0};
  return {c, c, SE3::fromEuler(0.001, 0.004, -0.002, {-0.0695, -0.0001, -0.0007})};
}

std::filesystem::path calibFile(const TemporaryFolder& folder, const std::string& text) {
  const auto path = folder.path() / "stereo.calib";
  test::writeText(path, text);
  return path;
}

std::string calibRefusal(const std::filesystem::path& path) {
  return test::refusal([&] { (void)readStereoCalib(path); });
}

TEST(StereoCalib, ReadsTheRealRig) {
  FATHOM_REQUIRE_DATA("acfr/ng2_20070520_subset1.calib");
  const StereoRig rig = readStereoCalib(test::dataFile("acfr/ng2_20070520_subset1.calib"));
  EXPECT_EQ(rig.left.width, 1360);
  EXPECT_NEAR(rig.left.fx, 1711.82, 0.005);
  EXPECT_NEAR(rig.right.fx, 1712.22, 0.005);
  EXPECT_NEAR(rig.left.k1, 0.135773, 1e-9);
  EXPECT_NEAR(rig.left.k2, 0.734495, 1e-9);
  EXPECT_NEAR(rig.baseline(), 0.06949, 1e-5);
}

TEST(StereoCalib, RoundTripsWithAndWithoutTheThirdRadialTerm) {
  const TemporaryFolder folder;
  for (const double k3 : {0.0, -0.25}) {
    StereoRig rig = surveyRig();
    rig.right.k3 = k3;
    writeStereoCalib(folder.path() / "stereo.calib", rig);
    const StereoRig in = readStereoCalib(folder.path() / "stereo.calib");
    EXPECT_EQ(in.right.k3, k3);
    EXPECT_EQ(in.left.fy, rig.left.fy);
    EXPECT_LT((in.T_right_left.inverse() * rig.T_right_left).log().norm(), 1e-9);
  }
}

TEST(StereoCalib, RefusesBadFilesNamingTheNumber) {
  const TemporaryFolder folder;
  EXPECT_NE(calibRefusal(folder.path() / "absent.calib"), "");
  EXPECT_THAT(calibRefusal(calibFile(folder, "")), HasSubstr("holds 0 numbers"));
  EXPECT_THAT(calibRefusal(calibFile(folder, "2 1360 1024 17")), HasSubstr("holds 4 numbers"));
  EXPECT_THAT(calibRefusal(calibFile(folder, "2 1360 fish")), HasSubstr("number 3"));
  EXPECT_THAT(calibRefusal(calibFile(folder, "2 1360 nan")), HasSubstr("number 3"));

  writeStereoCalib(folder.path() / "good.calib", surveyRig());
  const std::string good = test::readText(folder.path() / "good.calib");
  EXPECT_EQ(calibRefusal(calibFile(folder, good)), "");
  EXPECT_THAT(calibRefusal(calibFile(folder, "3" + good.substr(1))), HasSubstr("number of cameras"));
  EXPECT_THAT(calibRefusal(calibFile(folder, "2\n-5" + good.substr(6))), HasSubstr("image size"));
}

TEST(Triangulation, MidpointRecoversAPointFromTwoDistortedCameras) {
  const StereoRig rig = surveyRig();
  const Eigen::Vector3d truth(0.3, -0.2, 2.1);
  Eigen::Vector3d point;
  double gap = 1;
  ASSERT_TRUE(triangulateMidpoint(rig, rig.left.ray(rig.left.project(truth)),
                                  rig.right.ray(rig.right.project(rig.T_right_left * truth)), point, gap));
  EXPECT_LT((point - truth).norm(), 1e-6);
  EXPECT_LT(gap, 1e-8);
}

TEST(Triangulation, ParallelAndDivergingRaysGiveNoPoint) {
  const StereoRig rig = surveyRig();
  Eigen::Vector3d point;
  double gap = 0;
  const Eigen::Vector3d ray(0, 0, 1);
  EXPECT_FALSE(triangulateMidpoint(rig, ray, rig.T_right_left.rotation() * ray, point, gap));
  EXPECT_FALSE(triangulateMidpoint(rig, {-0.1, 0, 1}, {0.1, 0, 1}, point, gap));
}

FlatPort port() {
  return FlatPort{.air = {1360, 1024, 1290, 1288, 682, 508, -0.12, 0.08, 0.0006, -0.0004},
                  .normal = Eigen::Vector3d(0.02, -0.03, 1).normalized(),
                  .distance = 0.03,
                  .glass = 0.012};
}

StereoRig rigBehindPorts() {
  FlatPort right = port();
  right.normal = Eigen::Vector3d(-0.01, 0.02, 1).normalized();
  right.distance = 0.025;
  return {behindPort(port()), behindPort(right),
          SE3::fromEuler(0.002, -0.004, 0.001, {-0.12, 0.001, -0.002})};
}

// Fermat's principle: the optical path through a point of each face is the shortest. Found by descent,
// without Snell's law.
Eigen::Vector3d shortestPathInAir(const FlatPort& p, const Eigen::Vector3d& point) {
  const Eigen::Vector3d across = (point - p.normal.dot(point) * p.normal);
  const double far = across.norm(), along = p.normal.dot(point);
  const auto path = [&](double inner, double outer) {
    return std::hypot(p.distance, inner) + p.glass_index * std::hypot(p.glass, outer - inner) +
           p.water_index * std::hypot(along - p.distance - p.glass, far - outer);
  };
  double inner = 0, outer = 0;
  for (double step = far; step > 1e-12; step *= 0.7)
    for (int turn = 0; turn < 8; ++turn)
      for (const auto& [i, o] :
           {std::pair{step, 0.0}, {-step, 0.0}, {0.0, step}, {0.0, -step}, {step, step}, {-step, -step}})
        if (path(inner + i, outer + o) < path(inner, outer)) inner += i, outer += o;
  return inner * across.normalized() + p.distance * p.normal;
}

TEST(FlatPort, ProjectsAlongTheShortestOpticalPath) {
  const FlatPort p = port();
  for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.6, -0.4, 1.6), Eigen::Vector3d(-0.3, 0.5, 2.2),
                                       Eigen::Vector3d(0.05, 0.02, 0.5), Eigen::Vector3d(1.2, 0.9, 4)})
    EXPECT_LT((p.project(point) - p.air.project(shortestPathInAir(p, point))).norm(), 0.02);
}

TEST(FlatPort, RayLeadsBackToThePoint) {
  const Camera camera = behindPort(port());
  for (const double z : {0.4, 1.0, 2.0, 5.0})
    for (const double u : {0.0, 300.0, 682.0, 1359.0})
      for (const double v : {0.0, 508.0, 1023.0}) {
        const Eigen::Vector2d pixel(u, v);
        EXPECT_LT((camera.project(z * camera.ray(pixel, z)) - pixel).norm(), 1e-7) << z << ' ' << pixel;
      }
}

TEST(FlatPort, OfWaterAndGlassLikeAirIsNone) {
  FlatPort p = port();
  p.glass_index = p.water_index = 1;
  const Camera camera = behindPort(p);
  EXPECT_NEAR(camera.fx, p.air.fx, 1e-6);
  EXPECT_NEAR(camera.k1, p.air.k1, 1e-8);
  EXPECT_LT((camera.project({0.3, -0.2, 1.4}) - p.air.project({0.3, -0.2, 1.4})).norm(), 1e-9);
}

TEST(FlatPort, CentralCameraIsNearAtItsDepthAlone) {
  FlatPort straight = port();
  straight.normal = Eigen::Vector3d::UnitZ();
  const Camera camera = behindPort(straight);
  Camera central = camera;
  central.port.reset();
  double worst = 0, nearer = 0;
  for (double u = 0; u < 1360; u += 80)
    for (double v = 0; v < 1024; v += 64) {
      const Eigen::Vector3d ray = camera.ray({u, v}, kPortDepth);
      worst = std::max(worst, (central.project(kPortDepth * ray) - Eigen::Vector2d(u, v)).norm());
      nearer = std::max(nearer, (central.project(ray) - camera.project(0.4 * kPortDepth * ray)).norm());
    }
  EXPECT_LT(worst, 0.05);
  EXPECT_GT(nearer, 1);
  std::printf("central camera: %.4f px at %g m, %.2f px at %g m; focal length %.1f px in air, %.1f px\n",
              worst, kPortDepth, nearer, 0.4 * kPortDepth, port().air.fx, camera.fx);
}

TEST(FlatPort, PixelsTriangulateAtEveryDepth) {
  const StereoRig rig = rigBehindPorts();
  for (const double z : {0.5, 1.0, 2.0, 4.0, 8.0}) {
    const Eigen::Vector3d truth = z * Eigen::Vector3d(0.2, -0.25, 1);
    Eigen::Vector3d point;
    double gap = 0;
    ASSERT_TRUE(triangulatePixels(rig, rig.left.project(truth), rig.right.project(rig.T_right_left * truth),
                                  point, gap));
    EXPECT_LT((point - truth).norm(), 2e-6) << z;
    EXPECT_LT(gap, 1e-6 * z);
  }
}

TEST(FlatPort, ScaledKeepsItsDirections) {
  const Camera camera = behindPort(port()), half = camera.scaled(0.5);
  const Eigen::Vector3d point(0.3, 0.2, 1.1);
  const Eigen::Vector2d full = camera.project(point);
  EXPECT_LT((half.project(point) - (0.5 * full - Eigen::Vector2d::Constant(0.25))).norm(), 1e-9);
}

TEST(FlatPort, IsWrittenBesideItsCalibration) {
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "stereo.calib";
  const StereoRig rig = rigBehindPorts();
  writeStereoCalib(path, rig);
  ASSERT_TRUE(std::filesystem::exists(portsBeside(path)));
  const StereoRig in = readStereoCalib(path);
  const Eigen::Vector3d point(0.3, 0.2, 1.1);
  EXPECT_LT((in.left.project(point) - rig.left.project(point)).norm(), 1e-9);
  EXPECT_LT((in.right.project(point) - rig.right.project(point)).norm(), 1e-9);
  StereoRig bare = rig;
  bare.left.port.reset(), bare.right.port.reset();
  writeStereoCalib(path, bare);
  EXPECT_FALSE(std::filesystem::exists(portsBeside(path)));
}

TEST(FlatPort, RefusesNumbersOutOfRange) {
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "stereo.calib";
  writeStereoCalib(path, rigBehindPorts());
  const auto refusal = [&](const std::string& numbers) {
    test::writeText(portsBeside(path), numbers);
    return test::refusal([&] { (void)readStereoCalib(path); });
  };
  EXPECT_THAT(refusal("0 0 1 0.02 0.01 1.49"), HasSubstr("holds 6 numbers"));
  EXPECT_THAT(refusal("0 0 -1 0.02 0.01 1.49 1.34 0 0 1 0.02 0.01 1.49 1.34"), HasSubstr("normal"));
  EXPECT_THAT(refusal("0 0 1 20 0.01 1.49 1.34 0 0 1 20 0.01 1.49 1.34"), HasSubstr("0 to 1 m"));
  EXPECT_THAT(refusal("0 0 1 0.02 0.01 1.49 3 0 0 1 0.02 0.01 1.49 1.34"), HasSubstr("index"));
}

}  // namespace
}  // namespace fathom
