#include "recon/geometry/flat_port.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>

#include "recon/geometry/stereo_rig.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom {
namespace {

FlatPort port() {
  FlatPort out;
  out.air = {1360, 1024, 1290, 1288, 682, 508, -0.12, 0.08, 0.0006, -0.0004};
  out.normal = Eigen::Vector3d(0.02, -0.03, 1).normalized();
  out.distance = 0.03;
  out.glass = 0.012;
  return out;
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
  EXPECT_NE(refusal("0 0 1 0.02 0.01 1.49").find("holds 6 numbers"), std::string::npos);
  EXPECT_NE(refusal("0 0 -1 0.02 0.01 1.49 1.34 0 0 1 0.02 0.01 1.49 1.34").find("normal"),
            std::string::npos);
  EXPECT_NE(refusal("0 0 1 20 0.01 1.49 1.34 0 0 1 20 0.01 1.49 1.34").find("0 to 1 m"), std::string::npos);
  EXPECT_NE(refusal("0 0 1 0.02 0.01 1.49 3 0 0 1 0.02 0.01 1.49 1.34").find("index"), std::string::npos);
}

}  // namespace
}  // namespace fathom
