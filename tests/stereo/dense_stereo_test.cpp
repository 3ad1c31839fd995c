#include "recon/stereo/dense_stereo.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "tests/world/pictures.hpp"

namespace fathom::stereo {
namespace {

using test::croppedRig, test::Sheet, test::SyntheticScene;

constexpr int kDenseWidth = 640, kDenseHeight = 480;  // [px]

SparseStereoConfig wanted(int points) {
  return SparseStereoConfig{.max_features = points};
}

std::vector<double> depthErrors(const SyntheticScene& scene, const StereoResult& result) {
  std::vector<double> errors;
  for (const StereoPoint& p : result.points) {
    Eigen::Vector3d truth;
    if (scene.pointAt(p.left.cast<double>(), truth))
      errors.push_back(std::abs(static_cast<double>(p.point.z()) - truth.z()));
  }
  std::sort(errors.begin(), errors.end());
  return errors;
}

TEST(DenseStereo, ARollingFloorComesOutWhereItIsWithTheStatedUncertainty) {
  const Sheet floor{
      [](double x, double y) { return 2.0 + 0.2 * x + 0.04 * std::sin(9 * x) * std::cos(7 * y); }};
  const SyntheticScene scene(croppedRig(kDenseWidth, kDenseHeight), {floor});
  const auto [left, right] = scene.render({1.0, 0.0, 2.0}, {0.9, 6.0, 2.0});
  DenseStereo stereo(scene.rig(), wanted(1500), {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {});
  EXPECT_LE(result.corners, 1500U);
  EXPECT_GE(result.points.size(), 1000U);
  EXPECT_GT(result.triangles.size(), 1500U);
  const std::vector<double> errors = depthErrors(scene, result);
  ASSERT_GT(errors.size(), 1000U);
  std::size_t within = 0;
  for (const StereoPoint& p : result.points) {
    Eigen::Vector3d truth;
    if (!scene.pointAt(p.left.cast<double>(), truth)) continue;
    within +=
        std::abs(static_cast<double>(p.point.z()) - truth.z()) < 2 * static_cast<double>(p.sigma_z) ? 1 : 0;
  }
  std::printf("dense: %zu points, depth error median %.1f mm, 95 %% %.1f mm, within two sigma %.1f %%\n",
              errors.size(), 1e3 * errors[errors.size() / 2], 1e3 * errors[errors.size() * 95 / 100],
              100.0 * static_cast<double>(within) / static_cast<double>(errors.size()));
  EXPECT_LT(errors[errors.size() / 2], 0.002);
  EXPECT_LT(errors[errors.size() * 95 / 100], 0.006);
  EXPECT_GE(static_cast<double>(within), 0.9 * static_cast<double>(errors.size()));
}

TEST(DenseStereo, NoTriangleSpansTheStepOfABlock) {
  const Sheet floor{[](double, double) { return 2.0; }};
  const Sheet top{[](double, double) { return 1.6; },
                  [](double x, double y) { return std::abs(x) < 0.12 && std::abs(y) < 0.1; }};
  const SyntheticScene scene(croppedRig(kDenseWidth, kDenseHeight), {floor, top});
  const auto [left, right] = scene.render({}, {});
  SparseStereoConfig limits = wanted(2000);
  limits.search_radius = 40;   // 1.6 m is 15 px from the plane at 2 m
  limits.max_fish_length = 0;  // a block twice as high as wide, with no flank to be seen, passes for a fish
  DenseStereo stereo(scene.rig(), limits, {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {});
  std::size_t on_top = 0;
  for (const StereoPoint& p : result.points) on_top += p.point.z() < 1.7F ? 1 : 0;
  EXPECT_GT(on_top, 50U);
  for (const auto& t : result.triangles) {
    float least = 10, most = 0;
    for (const std::uint32_t i : t) {
      least = std::min(least, result.points[i].point.z());
      most = std::max(most, result.points[i].point.z());
    }
    EXPECT_LT(most - least, 0.35F);
  }
}

TEST(DenseStereo, UnusableInputGivesAnEmptyResultAndUnusableRigsAreRefused) {
  const StereoRig rig = croppedRig(kDenseWidth, kDenseHeight);
  DenseStereo stereo(rig, {}, {});
  EXPECT_TRUE(stereo.process({}, {}, {}).points.empty());
  StereoRig swapped = rig;
  swapped.T_right_left = SE3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), {0.07, 0, 0});
  EXPECT_THROW(DenseStereo(swapped, {}, {}), std::invalid_argument);
  StereoRig upright = rig;
  upright.T_right_left = SE3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), {0, -0.07, 0});
  EXPECT_THROW(DenseStereo(upright, {}, {}), std::invalid_argument);
  EXPECT_THROW(DenseStereo(rig, {}, {.scale = 2, .block = 5}), std::invalid_argument);
  EXPECT_THROW(DenseStereo(rig, {}, {.scale = 0.5, .block = 4}), std::invalid_argument);
}

TEST(DisparityCells, APlaneIsKeptExactlyAndCellsGatherWhereItBends) {
  constexpr int kSide = 256;
  std::vector<float> disparity(kSide * kSide);
  const auto at = [](int x, int y) {
    const double bump = std::hypot(x - 190, y - 60) < 25 ? 3 * std::cos(0.2 * x) : 0;
    return 30 + 0.03 * x - 0.02 * y + bump;
  };
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      disparity[static_cast<std::size_t>(y * kSide + x)] = static_cast<float>(at(x, y));
  DisparityCells cells;
  const auto& found = cells.simplify(disparity, kSide, kSide, 300);
  EXPECT_LE(found.size(), 300U);
  EXPECT_GE(found.size(), 290U);
  double area = 0, near_edge = 0, far_edge = 0;
  int near = 0, far = 0;
  for (const DisparityCell& c : found) {
    area += c.width * c.height;
    const bool on_bump = std::hypot(c.centre.x() - 190, c.centre.y() - 60) < 20;
    (on_bump ? near_edge : far_edge) += c.width;
    ++(on_bump ? near : far);
    if (std::hypot(c.centre.x() - 190, c.centre.y() - 60) > 50) {
      EXPECT_NEAR(c.mean, 30 + 0.03 * c.centre.x() - 0.02 * c.centre.y(), 1e-4);
      EXPECT_LT(c.rms, 1e-3);
    }
  }
  EXPECT_EQ(area, kSide * kSide);  // each pixel in one cell
  EXPECT_LT(near_edge / near, 0.6 * far_edge / far);
}

TEST(DisparityCells, HolesAreLeftOutAndNothingGivesNothing) {
  std::vector<float> disparity(64 * 64, NAN);
  DisparityCells cells;
  EXPECT_TRUE(cells.simplify(disparity, 64, 64, 50).empty());
  EXPECT_TRUE(cells.simplify(disparity, 64, 63, 50).empty());
  for (int y = 20; y < 30; ++y)
    for (int x = 20; x < 30; ++x) disparity[static_cast<std::size_t>(y * 64 + x)] = 5;
  int valid = 0;
  for (const DisparityCell& c : cells.simplify(disparity, 64, 64, 50)) {
    valid += c.valid;
    EXPECT_NEAR(c.mean, 5, 1e-6);
  }
  EXPECT_EQ(valid, 100);
}

}  // namespace
}  // namespace fathom::stereo
