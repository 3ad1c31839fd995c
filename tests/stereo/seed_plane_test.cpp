#include "recon/stereo/seed_plane.hpp"

#include <gtest/gtest.h>

#include <random>

namespace fathom::stereo {
namespace {

// Points of a plane seen through 40 by 30 degrees, with noise of `sigma` m and a share of gross errors nearer
// by half.
std::vector<StereoPoint> pointsOf(const SeedPlane& plane, int count, double sigma, double gross) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> x(-0.36, 0.36), y(-0.27, 0.27), chance(0, 1);
  std::normal_distribution<double> noise(0, sigma);
  std::vector<StereoPoint> points;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d ray(x(random), y(random), 1);
    double z = plane.distance / plane.normal.dot(ray) + noise(random);
    if (chance(random) < gross) z *= 0.5 + 0.1 * chance(random);
    points.emplace_back();
    points.back().point = (ray * z).cast<float>();
  }
  return points;
}

TEST(SeedPlane, IsRecoveredThroughAThirdOfGrossErrors) {
  const SeedPlane truth{Eigen::Vector3d(0.12, -0.2, 1).normalized(), 2.4};
  const auto plane = fitSeedPlane(pointsOf(truth, 300, 0.01, 0.33));
  ASSERT_TRUE(plane.has_value());
  EXPECT_NEAR(plane->distance, truth.distance, 0.02);
  EXPECT_LT((plane->normal - truth.normal).norm(), 0.02);
}

TEST(SeedPlane, IsAbsentForTooFewPoints) {
  const SeedPlane truth{Eigen::Vector3d::UnitZ(), 2};
  EXPECT_FALSE(fitSeedPlane(pointsOf(truth, 11, 0.01, 0)).has_value());
  std::vector<StereoPoint> one_ray(50);
  for (StereoPoint& p : one_ray) p.point = {0.1F, 0.1F, 2.0F};
  EXPECT_FALSE(fitSeedPlane(one_ray).has_value());
}

TEST(SeedPlane, AWideSearchReachesBothEndsOfTheRangesOrTheFarOne) {
  StereoRig rig;
  rig.left = {1360, 1024, 1700, 1700, 680, 512};
  rig.right = rig.left;
  rig.T_right_left = SE3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), {-0.07, 0, 0});
  const auto disparity = [](double z) { return 1700 * 0.07 / z; };
  const WideSearch both = wideSearch(rig, 0.5, 12);
  EXPECT_NEAR(disparity(both.plane.distance) + both.search_radius, disparity(0.5), 1e-6);
  EXPECT_NEAR(disparity(both.plane.distance) - both.search_radius, disparity(12), 1e-6);
  const WideSearch far = wideSearch(rig, 0.1, 12);
  EXPECT_EQ(far.search_radius, 256);
  EXPECT_NEAR(disparity(far.plane.distance) - far.search_radius, disparity(12), 1e-6);
}

}  // namespace
}  // namespace fathom::stereo
