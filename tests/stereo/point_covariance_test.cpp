#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "recon/geometry/symmetric_eigen.hpp"
#include "recon/stereo/match_points.hpp"
#include "recon/stereo/midpoint_triangulation.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "tests/stereo/synthetic_scene.hpp"

namespace fathom::stereo {
namespace {

using test::croppedRig;
using test::Exposure;
using test::Sheet;
using test::SyntheticScene;

struct Normalised {
  double sigma;  // reported [m]
  double error;  // of z, in reported standard deviations
};

double rms(const std::vector<Normalised>& errors, std::size_t begin, std::size_t end) {
  double sum = 0;
  for (std::size_t i = begin; i < end; ++i) sum += errors[i].error * errors[i].error;
  return std::sqrt(sum / static_cast<double>(end - begin));
}

// Tilted ground, so that windows differ by more than noise.
std::vector<Normalised> errorsOf(const Exposure& left_exposure, const Exposure& right_exposure) {
  const Sheet floor{[](double x, double y) { return 2.0 + 0.2 * x + 0.1 * y; }};
  const SyntheticScene scene(croppedRig(640, 480), {floor});
  const auto [left, right] = scene.render(left_exposure, right_exposure);
  SparseStereoConfig config;
  config.max_features = 1200;
  SparseStereo stereo(scene.rig(), config);
  std::vector<Normalised> errors;
  for (const StereoPoint& p : stereo.process(left.view(), right.view(), {}).points) {
    Eigen::Vector3d truth;
    if (!scene.pointAt(p.left.cast<double>(), truth)) continue;
    const double sigma = static_cast<double>(p.sigma_z);
    errors.push_back({sigma, (static_cast<double>(p.point.z()) - truth.z()) / sigma});
  }
  std::sort(errors.begin(), errors.end(),
            [](const Normalised& a, const Normalised& b) { return a.sigma < b.sigma; });
  return errors;
}

class SigmaZ : public testing::TestWithParam<std::pair<Exposure, Exposure>> {};

TEST_P(SigmaZ, MatchesTheErrorsWithinAFifthInEveryThirdOfThePointsRankedByIt) {
  const auto errors = errorsOf(GetParam().first, GetParam().second);
  const std::size_t n = errors.size();
  ASSERT_GE(n, 900U);
  EXPECT_NEAR(rms(errors, 0, n), 1.0, 0.2);
  for (std::size_t third = 0; third < 3; ++third)
    EXPECT_NEAR(rms(errors, third * n / 3, (third + 1) * n / 3), 1.0, 0.2) << third;
  // Reported sigmas differ in fact: points in the worst tenth are clearly less accurate.
  EXPECT_GE(errors[n * 9 / 10].sigma, 1.2 * errors[n / 10].sigma);
}

INSTANTIATE_TEST_SUITE_P(Noise, SigmaZ,
                         testing::Values(std::pair<Exposure, Exposure>{{1.0, 0.0, 1.0}, {1.0, 0.0, 1.0}},
                                         std::pair<Exposure, Exposure>{{1.0, 0.0, 2.0}, {0.8, 12.0, 3.0}},
                                         std::pair<Exposure, Exposure>{{1.0, 0.0, 6.0}, {0.6, 20.0, 4.0}}));

TEST(MidpointTriangulation, AgreesWithTheRigsOwnAndItsCovarianceWithNumericalDerivatives) {
  const StereoRig rig = croppedRig(1360, 1024);
  const MidpointTriangulation triangulation(rig);
  const Eigen::Vector2d left(1204, 133),
      right_true = rig.right.project(rig.T_right_left * (rig.left.ray(left) * 2.3));
  const Eigen::Vector2d right = right_true + Eigen::Vector2d(0.1, 0.3);  // rays that do not meet
  const auto point = [&](const Eigen::Vector2d& l, const Eigen::Vector2d& r) {
    Eigen::Vector3d p;
    EXPECT_TRUE(triangulation.point(rig.left.ray(l), rig.right.ray(r), p));
    return p;
  };
  Eigen::Vector3d expected;
  double gap = 0;
  ASSERT_TRUE(triangulateMidpoint(rig, rig.left.ray(left), rig.right.ray(right), expected, gap));
  EXPECT_LT((point(left, right) - expected).norm(), 1e-9);

  Eigen::Matrix2d s_left, s_right;
  s_left << 0.02, 0.005, 0.005, 0.01;
  s_right << 0.03, -0.01, -0.01, 0.04;
  Eigen::Matrix<double, 3, 4> jacobian;
  constexpr double kStep = 1e-4;  // [px]
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(i);
    jacobian.col(i) = (point(left + step, right) - point(left - step, right)) / (2 * kStep);
    jacobian.col(2 + i) = (point(left, right + step) - point(left, right - step)) / (2 * kStep);
  }
  Eigen::Matrix4d pixels = Eigen::Matrix4d::Zero();
  pixels.topLeftCorner<2, 2>() = s_left;
  pixels.bottomRightCorner<2, 2>() = s_right;
  const Eigen::Matrix3d numerical = jacobian * pixels * jacobian.transpose();
  const Eigen::Matrix3d analytic =
      triangulation.covariance(rig.left.ray(left), rig.right.ray(right), s_left, s_right);
  EXPECT_LT((analytic - numerical).norm(), 1e-5 * numerical.norm());
}

TEST(MidpointTriangulation, DepthErrorFollowsTheTheoryOfParallelCameras) {
  StereoRig rig;
  rig.left = rig.right = Camera{.width = 1000, .height = 800, .fx = 1000, .fy = 1000, .cx = 500, .cy = 400};
  rig.T_right_left = SE3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), {-0.1, 0, 0});
  const double z = 3.0, sigma_d = 0.2;
  const Eigen::Vector2d left(500, 400), right(500 - 1000 * 0.1 / z, 400);
  const Eigen::Matrix3d c =
      MidpointTriangulation(rig).covariance(rig.left.ray(left), rig.right.ray(right), Eigen::Matrix2d::Zero(),
                                            Eigen::Vector2d(sigma_d * sigma_d, 0).asDiagonal());
  EXPECT_NEAR(std::sqrt(c(2, 2)), z * z * sigma_d / (1000 * 0.1), 1e-3 * z * z * sigma_d / 100);
}

TEST(MidpointTriangulation, RaysThatAreParallelOrMeetBehindTheCamerasGiveNoPoint) {
  const StereoRig rig = croppedRig(1360, 1024);
  const MidpointTriangulation triangulation(rig);
  Eigen::Vector3d p;
  const Eigen::Vector3d ahead(0.1, 0.2, 1);
  EXPECT_FALSE(triangulation.point(ahead, rig.T_right_left.rotation() * ahead, p));
  EXPECT_FALSE(triangulation.point({-0.3, 0, 1}, {0.3, 0, 1}, p));
}

TEST(SparseStereo, CovarianceIsPositiveDefiniteLongestAlongTheRayAndHoldsSigmaZ) {
  const SyntheticScene scene(croppedRig(640, 480), {Sheet{[](double, double) { return 2.0; }}});
  const auto [left, right] = scene.render({1.0, 0.0, 2.0}, {0.8, 12.0, 3.0});
  SparseStereo stereo(scene.rig(), {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {});
  ASSERT_GE(result.points.size(), 700U);
  for (const StereoPoint& p : result.points) {
    const auto& c = p.covariance;
    Eigen::Matrix3d m;
    m << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
    const SymmetricEigen<3> eigen = symmetricEigen(m);
    EXPECT_GT(eigen.values[0], 0);
    EXPECT_GT(std::abs(eigen.vectors.col(2).dot(p.point.cast<double>().normalized())), 0.99);
    EXPECT_NEAR(std::sqrt(c[5]), p.sigma_z, 1e-4F * p.sigma_z);
  }
}

TEST(MatchNoise, FindsTheScaleThroughACalibrationErrorAndWrongMatches) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  MatchNoise noise(1000);
  for (int i = 0; i < 1000; ++i) {
    const double sigma = 0.03 + 0.05 * (i % 7) / 7.0;
    const double calibration = 0.2 + 0.0005 * i;
    const double distance = calibration + 1.8 * sigma * normal(random) + (i % 25 == 0 ? 0.9 : 0.0);
    noise.add({distance, {0, 1}}, Eigen::Vector2d(1, sigma * sigma).asDiagonal());
  }
  EXPECT_NEAR(noise.scale(), 1.8, 0.2);
  noise.clear();
  EXPECT_EQ(noise.scale(), MatchNoise::kUsual);
}

}  // namespace
}  // namespace fathom::stereo
