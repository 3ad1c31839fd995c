#include "recon/lighting/range_lattice.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "recon/lighting/rig_ranges.hpp"

namespace fathom::lighting {
namespace {

Camera wideCamera() {
  return {1360, 1024, 1711, 1712, 680, 512, 0.13, 0.7, 0.001, -0.001, 0};
}

TEST(RangeLattice, OfATiltedPlaneIsThePathAlongEachRay) {
  const Camera cam = wideCamera();
  const Eigen::Vector3d normal = Eigen::Vector3d(0.1, -0.15, 1).normalized();
  RangeLattice lattice;
  RangeMaker(cam).fromPlane(normal, 3.0, lattice);
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(0, 0), {1359, 0}, {680, 512}, {300, 800}, {1100, 900}}) {
    const Eigen::Vector3d ray = cam.ray(pixel).normalized();
    EXPECT_NEAR(static_cast<double>(
                    lattice.at(static_cast<float>(pixel.x() / 1359), static_cast<float>(pixel.y() / 1023))),
                3.0 / normal.dot(ray), 0.005);
  }
}

TEST(RangeLattice, RaysThatMeetNoPlaneAreUnknown) {
  RangeLattice lattice;
  RangeMaker(wideCamera()).fromPlane(Eigen::Vector3d(1, 0, 0.1), 2.0, lattice);
  EXPECT_EQ(lattice.at(0.0F, 0.5F), 0.0F);
  EXPECT_GT(lattice.at(1.0F, 0.5F), 0.0F);
  RangeMaker(wideCamera())
      .fromPlane(Eigen::Vector3d::UnitZ(), std::numeric_limits<double>::quiet_NaN(), lattice);
  EXPECT_EQ(lattice.at(0.5F, 0.5F), 0.0F);
}

TEST(RangeLattice, BendsToPointsAndFillsHolesFromAround) {
  const Camera cam = wideCamera();
  const RangeMaker maker(cam);
  RangeLattice lattice, truth;
  maker.fromPlane(Eigen::Vector3d::UnitZ(), 3.0, lattice);  // by the altitude
  maker.fromPlane(Eigen::Vector3d::UnitZ(), 2.0, truth);    // true
  std::mt19937 random(1);
  std::uniform_real_distribution<double> x(0, 1359), y(0, 1023);
  std::vector<Eigen::Vector3f> points;
  while (points.size() < 200) {
    const Eigen::Vector2d pixel(x(random), y(random));
    if (pixel.x() > 500 && pixel.x() < 900) continue;  // bare sand
    points.push_back((2.0 * cam.ray(pixel)).cast<float>());
  }
  points.emplace_back(0, 0, -1);
  points.emplace_back(std::numeric_limits<float>::quiet_NaN(), 0.0F, 2.0F);
  maker.bendTo(points, lattice);
  for (std::size_t k = 0; k < truth.path.size(); ++k) EXPECT_NEAR(lattice.path[k], truth.path[k], 0.02F) << k;
}

TEST(RangeLattice, FollowsALedge) {
  const Camera cam = wideCamera();
  const RangeMaker maker(cam);
  RangeLattice lattice;
  maker.fromPlane(Eigen::Vector3d::UnitZ(), 3.0, lattice);
  std::vector<Eigen::Vector3f> points;
  for (int y = 10; y < 1024; y += 40)
    for (int x = 10; x < 1360; x += 40)
      points.push_back(((x < 680 ? 2.0 : 6.0) * cam.ray(Eigen::Vector2d(x, y))).cast<float>());
  maker.bendTo(points, lattice);
  const auto depth = [&](double u) {
    const Eigen::Vector3d ray = cam.ray(Eigen::Vector2d(u * 1359, 512)).normalized();
    return static_cast<double>(lattice.at(static_cast<float>(u), 0.5F)) * ray.z();
  };
  EXPECT_NEAR(depth(0.25), 2.0, 0.05);
  EXPECT_NEAR(depth(0.40), 2.0, 0.10);
  EXPECT_NEAR(depth(0.60), 6.0, 0.30);
  EXPECT_NEAR(depth(0.75), 6.0, 0.15);
}

TEST(RangeLattice, WithoutPointsStaysThePlane) {
  const RangeMaker maker(wideCamera());
  RangeLattice lattice, before;
  maker.fromPlane(Eigen::Vector3d::UnitZ(), 3.0, lattice);
  before = lattice;
  maker.bendTo({}, lattice);
  EXPECT_EQ(lattice.path, before.path);
}

TEST(RigRanges, SeeOnePlaneFromBothCameras) {
  const Eigen::Vector3d right_in_left(0.07, 0.002, -0.003);
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitY()));
  const StereoRig rig{wideCamera(), wideCamera(), SE3(turn, turn * -right_in_left)};
  RigRanges ranges(rig);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.2, 0.1, 1).normalized();
  ranges.fromPlane(normal, 2.5);
  // Along the right wideCamera's axis, from its centre to the plane.
  const SE3 T_left_right = rig.T_right_left.inverse();
  const Eigen::Vector3d ray = T_left_right.rotation() * rig.right.ray({679.5, 511.5}).normalized();
  const double expected = (2.5 - normal.dot(T_left_right.translation())) / normal.dot(ray);
  EXPECT_NEAR(static_cast<double>(ranges.right().at(0.5F, 0.5F)), expected, 0.003);
}

}  // namespace
}  // namespace fathom::lighting
