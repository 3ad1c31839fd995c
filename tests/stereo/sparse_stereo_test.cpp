#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "recon/stereo/sparse_stereo.hpp"
#include "tests/support/strip_mask.hpp"
#include "tests/world/pictures.hpp"

namespace fathom::stereo {
namespace {

using test::croppedRig, test::Exposure, test::GrayImage, test::Sheet, test::SyntheticScene;

constexpr int kSparseWidth = 640, kSparseHeight = 480;  // [px]
// A strobe on the left: the right image is darker, hazier and noisier.
constexpr Exposure kLeft{1.0, 0.0, 2.0}, kRight{0.8, 12.0, 3.0};

Sheet level(double z) {
  return {[z](double, double) { return z; }};
}

struct Errors {
  std::vector<double> disparity;  // absolute, ascending [px]
  double outliers = 0;            // share of points with a depth error over 3 sigma_z + 1 cm
  double mean = 0;                // signed, of errors below one pixel [px]
  [[nodiscard]] double quantile(double q) const {
    return disparity.at(static_cast<std::size_t>(q * static_cast<double>(disparity.size() - 1)));
  }
  [[nodiscard]] double fractionAbove(double limit) const {
    const auto n = std::count_if(disparity.begin(), disparity.end(), [&](double e) { return e > limit; });
    return static_cast<double>(n) / static_cast<double>(disparity.size());
  }
};

Errors compare(const SyntheticScene& scene, const StereoResult& result) {
  Errors errors;
  std::size_t fine = 0;
  for (const StereoPoint& p : result.points) {
    Eigen::Vector3d truth;
    EXPECT_TRUE(scene.pointAt(p.left.cast<double>(), truth));
    const double e = static_cast<double>(p.right.x()) - scene.rightPixel(truth).x();
    errors.disparity.push_back(std::abs(e));
    const double off = std::abs(static_cast<double>(p.point.z()) - truth.z());
    errors.outliers += off > 3 * static_cast<double>(p.sigma_z) + 0.01 ? 1 : 0;
    if (std::abs(e) < 1.0) {
      errors.mean += e;
      ++fine;
    }
  }
  std::sort(errors.disparity.begin(), errors.disparity.end());
  errors.mean /= static_cast<double>(std::max<std::size_t>(fine, 1));
  errors.outliers /= static_cast<double>(std::max<std::size_t>(result.points.size(), 1));
  return errors;
}

StereoResult run(const SyntheticScene& scene, const SeedPlane& plane = {},
                 const SparseStereoConfig& config = {}) {
  const auto [left, right] = scene.render(kLeft, kRight);
  return SparseStereo(scene.rig(), config).process(left.view(), right.view(), plane);
}

struct Surface {
  const char* name;
  Sheet sheet;
};

class SparseStereoOn : public testing::TestWithParam<Surface> {};

TEST_P(SparseStereoOn, DisparityIsAccurateWithoutBiasWhenNoiseAndBrightnessDifferBetweenTheImages) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {GetParam().sheet});
  const StereoResult result = run(scene);
  EXPECT_GE(result.points.size(), 700U);
  const Errors errors = compare(scene, result);
  EXPECT_LE(errors.quantile(0.5), 0.06);
  EXPECT_LE(errors.quantile(0.99), 0.35);
  EXPECT_EQ(errors.fractionAbove(1.0), 0.0);
  EXPECT_LE(errors.outliers, 0.005);
  EXPECT_LE(std::abs(errors.mean), 0.01);
}

INSTANTIATE_TEST_SUITE_P(Surfaces, SparseStereoOn,
                         testing::Values(Surface{"Plane", level(2.0)},
                                         Surface{"Ramp35Degrees", {[](double x, double y) {
                                                   return 2.0 + 0.6 * x + 0.3 * y;
                                                 }}},
                                         Surface{"Bump", {[](double x, double y) {
                                                   return 2.0 - 0.4 * std::exp(-(x * x + y * y) / 0.02);
                                                 }}}),
                         [](const auto& instance) { return instance.param.name; });

TEST(SparseStereo, DepthHasNoBias) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)});
  const StereoResult result = run(scene);
  double sum = 0;
  for (const StereoPoint& p : result.points)
    sum += (static_cast<double>(p.point.z()) - 2.0) / static_cast<double>(p.sigma_z);
  EXPECT_LT(std::abs(sum / static_cast<double>(result.points.size())), 0.1);
}

TEST(SparseStereo, AltitudeErrorOfASeedPlaneIsCapturedByTheSearch) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)});
  for (const double distance : {1.45, 3.2}) {  // 24 px too near, 22 px too far
    const StereoResult result = run(scene, {Eigen::Vector3d::UnitZ(), distance});
    EXPECT_GE(result.points.size(), 600U) << distance;
    EXPECT_EQ(compare(scene, result).fractionAbove(1.0), 0.0) << distance;
  }
}

TEST(SparseStereo, GroundIsFoundWhereverItIsWhenTheAltitudeIsWrong) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)});
  for (const double distance : {0.9, 10.0}) {  // a DVL on a false bottom, or on none
    const StereoResult result = run(scene, {Eigen::Vector3d::UnitZ(), distance});
    EXPECT_GE(result.points.size(), 700U) << distance;
    const Errors errors = compare(scene, result);
    EXPECT_LE(errors.quantile(0.99), 0.2) << distance;
    EXPECT_EQ(errors.outliers, 0) << distance;
  }
}

TEST(SparseStereo, GroundThatIsFainterThanTheNoiseOfPixelsIsFoundAtHalfAndAQuarterOfTheSize) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)}, 0.01);
  const Exposure faint{0.1, 60, 3.0};
  const auto [left, right] = scene.render(faint, faint);
  const StereoResult result = SparseStereo(scene.rig(), {}).process(left.view(), right.view(), {});
  EXPECT_GE(result.points.size(), 200U);
  const Errors errors = compare(scene, result);
  EXPECT_LE(errors.quantile(0.5), 0.6);
  EXPECT_LE(errors.outliers, 0.01);
}

TEST(SparseStereo, PairOfLowContrastIsLookedAtAgainWithMoreCorners) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)});
  const Exposure faint{0.2, 60, 3.0};
  const auto [left, right] = scene.render(faint, faint);
  SparseStereoConfig config;
  const StereoResult once = SparseStereo(scene.rig(), config).process(left.view(), right.view(), {});
  EXPECT_LT(once.points.size(), 0.5 * config.max_features);
  config.look_again = true;
  const StereoResult again = SparseStereo(scene.rig(), config).process(left.view(), right.view(), {});
  EXPECT_GE(again.points.size(), 2 * once.points.size());
  const Errors before = compare(scene, once), after = compare(scene, again);
  EXPECT_LE(after.quantile(0.95), 1.1 * before.quantile(0.95));
  EXPECT_LE(after.outliers, 0.005);
}

TEST(SparseStereo, CornersReachEveryPartOfTheImageThoughOneQuarterHasMostContrast) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)});
  auto [left, right] = scene.render(kLeft, kRight);
  for (GrayImage* image : {&left, &right})
    for (int y = 0; y < kSparseHeight; ++y)
      for (int x = 0; x < kSparseWidth; ++x) {
        std::uint8_t& v = image->pixels[static_cast<std::size_t>(y * kSparseWidth + x)];
        if (x < kSparseWidth / 2 || y < kSparseHeight / 2) v = static_cast<std::uint8_t>(80 + v / 4);
      }
  SparseStereo stereo(scene.rig(), {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {});
  constexpr int kColumns = 8, kRows = 6;
  std::vector<int> counts(kColumns * kRows, 0);
  for (const StereoPoint& p : result.points)
    ++counts[static_cast<std::size_t>(static_cast<int>(p.left.y()) * kRows / kSparseHeight * kColumns +
                                      static_cast<int>(p.left.x()) * kColumns / kSparseWidth)];
  // The leftmost column is partly outside the right image.
  for (int row = 0; row < kRows; ++row)
    for (int column = 1; column < kColumns; ++column)
      EXPECT_GE(counts[static_cast<std::size_t>(row * kColumns + column)], 5) << row << ' ' << column;
}

TEST(SparseStereo, SmallFishAboveTheFloorIsRejected) {
  const Sheet fish{[](double, double) { return 1.5; },
                   [](double x, double y) { return x * x / (0.05 * 0.05) + y * y / (0.018 * 0.018) < 1; }};
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0), fish});
  const StereoResult result = run(scene);
  EXPECT_GE(result.points.size(), 600U);
  EXPECT_GE(result.rejected.outlier + result.rejected.fish, 1U);
  for (const StereoPoint& p : result.points) EXPECT_GT(p.point.z(), 1.9F) << p.left.transpose();
}

TEST(SparseStereo, StepAtTheEdgeOfACoralHeadIsKeptAndNoTriangleSpansIt) {
  const Sheet head{[](double, double) { return 1.6; },
                   [](double x, double y) { return x > 0.05 && y < 0.05; }};
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0), head});
  const StereoResult result = run(scene);
  EXPECT_LE(compare(scene, result).fractionAbove(1.0), 0.005);
  std::size_t on_head = 0, wanted = 0;
  for (const StereoPoint& p : result.points) on_head += p.point.z() < 1.8F ? 1 : 0;
  // The head fills this share of the image: nearly as many of the points must be on it, some are lost to
  // its edge.
  for (int y = 10; y < kSparseHeight; y += 20)
    for (int x = 10; x < kSparseWidth; x += 20) {
      Eigen::Vector3d point;
      ASSERT_TRUE(scene.pointAt({x, y}, point));
      wanted += point.z() < 1.8 ? 1 : 0;
    }
  const double share = static_cast<double>(wanted) / (kSparseWidth / 20 * kSparseHeight / 20);
  EXPECT_GE(static_cast<double>(on_head), 0.8 * share * static_cast<double>(result.points.size()));
  for (const auto& t : result.triangles) {
    const auto [low, high] = std::minmax(
        {result.points[t[0]].point.z(), result.points[t[1]].point.z(), result.points[t[2]].point.z()});
    EXPECT_LT(high - low, 0.3F);
  }
}

TEST(SparseStereo, WindowsAcrossAStepThatFollowTheWrongSideAreFoundByTheirMiddle) {
  // Narrow stripes of two depths: most windows hold both.
  const Sheet stripes{[](double, double) { return 1.8; },
                      [](double x, double) { return std::fmod(x + 1.0, 0.06) < 0.02; }};
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0), stripes});
  SparseStereoConfig config;
  const Errors with = compare(scene, run(scene, {}, config));
  config.max_core_distance = 10;
  const Errors without = compare(scene, run(scene, {}, config));
  EXPECT_GE(without.fractionAbove(1.0), 0.02);
  EXPECT_LE(with.fractionAbove(1.0), 0.5 * without.fractionAbove(1.0));
  EXPECT_GE(with.disparity.size(), 0.7 * static_cast<double>(without.disparity.size()));
}

TEST(SparseStereo, TrianglesFaceTheCameraAndKeepToTheLongestEdge) {
  SparseStereoConfig config{.max_edge = 0.06};
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)});
  const StereoResult result = run(scene, {}, config);
  ASSERT_GE(result.triangles.size(), 500U);
  for (const auto& t : result.triangles) {
    const Eigen::Vector3f &a = result.points[t[0]].point, &b = result.points[t[1]].point,
                          &c = result.points[t[2]].point;
    EXPECT_LT((b - a).cross(c - a).z(), 0.0F);
    EXPECT_LE(std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()}), 0.0601F);
  }
}

TEST(SparseStereo, WhatAMaskHidesInEitherImageGivesNoPointsAndNoTriangles) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)});
  const auto [left, right] = scene.render(kLeft, kRight);
  SparseStereo stereo(scene.rig(), {});
  const ImageMask in_left = test::stripMask(kSparseWidth, kSparseHeight, 200, 290),
                  in_right = test::stripMask(kSparseWidth, kSparseHeight, 450, 480);
  ImageView left_view = left.view(), right_view = right.view();
  left_view.mask = &in_left;
  right_view.mask = &in_right;
  const StereoResult& result = stereo.process(left_view, right_view, {});
  constexpr double kHalf = 7;  // of the window [px]
  for (const StereoPoint& p : result.points) {
    EXPECT_FALSE(in_left.hides(p.left.cast<double>(), kHalf)) << p.left.transpose();
    EXPECT_FALSE(in_right.hides(p.right.cast<double>(), kHalf)) << p.right.transpose();
  }
  for (const auto& t : result.triangles) {
    const auto [low, high] = std::minmax(
        {result.points[t[0]].left.x(), result.points[t[1]].left.x(), result.points[t[2]].left.x()});
    EXPECT_FALSE(low < 200 && high > 290) << low << ' ' << high;
  }
  EXPECT_GT(result.points.size(), 300U);
  for (const RigMatch& match : result.matches) EXPECT_FALSE(in_left.hides(match.left, kHalf));
}

TEST(SparseStereo, QuotaOfAFrameBoundsItsCorners) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)});
  const auto [left, right] = scene.render(kLeft, kRight);
  SparseStereo stereo(scene.rig(), {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {}, 150);
  EXPECT_LE(result.corners, 150U);
  EXPECT_GE(result.points.size(), 120U);
  EXPECT_LE(stereo.process(left.view(), right.view(), {}, 100000).corners, 800U);
}

TEST(SparseStereo, SameImagesGiveTheSameBytesWhateverWentBefore) {
  const SyntheticScene scene(croppedRig(kSparseWidth, kSparseHeight), {level(2.0)});
  const SyntheticScene other(croppedRig(kSparseWidth, kSparseHeight), {level(3.0)}, 0.004, 9);
  const auto [left, right] = scene.render(kLeft, kRight);
  const auto [other_left, other_right] = other.render(kLeft, kRight);
  SparseStereo fresh(scene.rig(), {}), used(scene.rig(), {});
  (void)used.process(other_left.view(), other_right.view(), {Eigen::Vector3d::UnitZ(), 3.0}, 300);
  const StereoResult& a = fresh.process(left.view(), right.view(), {});
  const StereoResult& b = used.process(left.view(), right.view(), {});
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    EXPECT_EQ(a.points[i].left, b.points[i].left);
    EXPECT_EQ(a.points[i].right, b.points[i].right);
    EXPECT_EQ(a.points[i].point, b.points[i].point);
    EXPECT_EQ(a.points[i].sigma_z, b.points[i].sigma_z);
  }
  EXPECT_EQ(a.triangles, b.triangles);
}

TEST(SparseStereo, EmptyBlackOrWronglyShapedImagesGiveNoPoints) {
  const StereoRig rig = croppedRig(320, 240);
  SparseStereo stereo(rig, {});
  const GrayImage black{320, 240, std::vector<std::uint8_t>(320 * 240, 0)};
  const auto points = [&](const ImageView& left, const ImageView& right, const SeedPlane& plane = {}) {
    return stereo.process(left, right, plane).points.size();
  };
  EXPECT_EQ(points(black.view(), black.view()), 0U);
  EXPECT_EQ(points({}, black.view()), 0U);
  EXPECT_EQ(points(black.view(), {}), 0U);
  ImageView wrong = black.view();
  wrong.width = 319;
  EXPECT_EQ(points(wrong, black.view()), 0U);
  wrong = black.view();
  wrong.bits = 12;
  EXPECT_EQ(points(black.view(), wrong), 0U);
  wrong = black.view();
  wrong.format = PixelFormat::kBayerRggb;
  EXPECT_EQ(points(wrong, black.view()), 0U);
  wrong = black.view();
  wrong.stride = 100;
  EXPECT_EQ(points(wrong, black.view()), 0U);
  const SyntheticScene scene(rig, {level(2.0)});
  const auto [left, right] = scene.render(kLeft, kRight);
  EXPECT_GT(points(left.view(), right.view()), 0U);
  EXPECT_EQ(points(left.view(), black.view()), 0U);
  EXPECT_EQ(points(left.view(), right.view(), {Eigen::Vector3d::UnitZ(), std::nan("")}), 0U);
  EXPECT_EQ(points(left.view(), right.view(), {Eigen::Vector3d::Zero(), 2.0}), 0U);
}

TEST(SparseStereo, NoiseAloneGivesNoPoints) {
  const StereoRig rig = croppedRig(kSparseWidth, kSparseHeight);
  SyntheticScene scene(rig, {level(2.0)});
  const auto [left, right] = scene.render({0.0, 60.0, 6.0}, {0.0, 60.0, 6.0});
  SparseStereo stereo(rig, {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {});
  EXPECT_EQ(result.points.size(), 0U);
}

TEST(SparseStereo, ConfigurationOutOfRangeIsRefused) {
  const StereoRig rig = croppedRig(320, 240);
  const auto refused = [&](auto change) {
    SparseStereoConfig config;
    change(config);
    EXPECT_THROW(SparseStereo(rig, config), std::invalid_argument);
  };
  refused([](SparseStereoConfig& c) { c.max_features = 0; });
  refused([](SparseStereoConfig& c) { c.max_features = 5001; });
  refused([](SparseStereoConfig& c) { c.window = 14; });
  refused([](SparseStereoConfig& c) { c.window = 33; });
  refused([](SparseStereoConfig& c) { c.max_epipolar_distance = 0; });
  refused([](SparseStereoConfig& c) { c.sigma_scale = std::nan(""); });
  refused([](SparseStereoConfig& c) { c.min_range = 13; });
  refused([](SparseStereoConfig& c) { c.max_slope = 1.6; });
  EXPECT_THROW(SparseStereo(StereoRig{}, {}), std::invalid_argument);
}

TEST(SparseStereo, StagesAreReportedInTheirOrder) {
  const StereoRig rig = croppedRig(320, 240);
  const SyntheticScene scene(rig, {level(2.0)});
  const auto [left, right] = scene.render(kLeft, kRight);
  SparseStereo stereo(rig, {});
  std::vector<std::string> stages;
  stereo.setStageObserver([&](const char* stage) { stages.emplace_back(stage); });
  (void)stereo.process(left.view(), right.view(), {});
  EXPECT_EQ(stages, (std::vector<std::string>{"pyramids", "corners", "tracking", "outliers", "triangles"}));
}

TEST(StereoMesh, CarriesPointsSigmaColoursAndNormalsTowardsTheCamera) {
  const StereoRig rig = croppedRig(320, 240);
  const SyntheticScene scene(rig, {level(2.0)});
  const StereoResult result = run(scene);
  ASSERT_GE(result.triangles.size(), 100U);
  std::vector<std::uint8_t> rgb(320 * 240 * 3);
  for (std::size_t i = 0; i < rgb.size(); i += 3) rgb[i] = 200, rgb[i + 1] = 100, rgb[i + 2] = 50;
  const Mesh mesh = toMesh(result, {rgb.data(), 320, 240, 320 * 3, PixelFormat::kRgb, 8});
  ASSERT_EQ(mesh.vertices.size(), result.points.size());
  ASSERT_EQ(mesh.colours.size(), result.points.size());
  ASSERT_EQ(mesh.sigma.size(), result.points.size());
  EXPECT_EQ(mesh.triangles, result.triangles);
  EXPECT_EQ(mesh.colours.front(), (Rgb{200, 100, 50}));
  EXPECT_EQ(mesh.vertices[7], result.points[7].point);
  EXPECT_LT(mesh.normals[mesh.triangles.front()[0]].z(), -0.8F);
  EXPECT_TRUE(toMesh(result, {}).colours.empty());
}

}  // namespace
}  // namespace fathom::stereo
