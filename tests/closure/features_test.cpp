#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "recon/closure/dot_kernels.hpp"
#include "recon/closure/feature_extractor.hpp"
#include "recon/closure/registration.hpp"
#include "tests/support/strip_mask.hpp"
#include "tests/world/pictures.hpp"

namespace fathom::closure {
namespace {

using test::lookingDown, test::Seafloor, test::smallRig;

Seafloor slope() {
  return {[](double n, double e) { return 2.0 + 0.15 * n - 0.1 * e; }, test::randomTexture(0.006, 9)};
}

// Of slope() along a feature's ray; camera and nav frames are the same in sample().
double slopeAlong(const Feature& feature) {
  const Eigen::Vector3d ray = smallRig().left.ray(feature.left.cast<double>());
  return 2.0 / (1 - 0.15 * ray.x() + 0.1 * ray.y());
}

std::size_t nearSlope(const FrameFeatures& frame) {
  return static_cast<std::size_t>(std::count_if(
      frame.features.begin(), frame.features.end(),
      [](const Feature& f) { return std::abs(static_cast<double>(f.point.z()) - slopeAlong(f)) < 0.1; }));
}

FrameFeatures sample(const FeatureConfig& config = {}) {
  const auto images = test::shoot(slope(), smallRig(), lookingDown(0, 0, 0, 0), 1);
  FeatureExtractor extractor(smallRig(), config);
  return extractor.process(images.first.view(), images.second.view());
}

TEST(Features, AreOnTheTrueSurfaceWithinTheirCovariance) {
  const FrameFeatures frame = sample();
  ASSERT_GT(frame.size(), 200U);
  double sum = 0;
  for (const Feature& f : frame.features) {
    const double error = static_cast<double>(f.point.z()) - slopeAlong(f);
    sum += error * error / static_cast<double>(f.covariance[5]);
  }
  const double ratio = std::sqrt(sum / static_cast<double>(frame.size()));
  EXPECT_GT(ratio, 0.4);
  EXPECT_LT(ratio, 1.5);
}

TEST(Features, AreSpreadOverTheImageAndNotMoreThanWanted) {
  FeatureConfig config;
  config.max_features = 120;
  const FrameFeatures frame = sample(config);
  ASSERT_LE(frame.size(), 120U);
  ASSERT_GT(frame.size(), 80U);
  int quadrant[4] = {};
  for (const Feature& f : frame.features) ++quadrant[(f.left.x() > 240 ? 1 : 0) + (f.left.y() > 192 ? 2 : 0)];
  for (const int count : quadrant) EXPECT_GT(count, 12);
}

TEST(Features, AreNoneWhereAMaskHidesEitherImage) {
  const auto images = test::shoot(slope(), smallRig(), lookingDown(0, 0, 0, 0), 1);
  ImageView left = images.first.view(), right = images.second.view();
  const ImageMask in_left = test::stripMask(left.width, left.height, 0, 150),
                  in_right = test::stripMask(right.width, right.height, 300, 350);
  left.mask = &in_left;
  right.mask = &in_right;
  FeatureExtractor extractor(smallRig(), {});
  const FrameFeatures& found = extractor.process(left, right);
  ASSERT_GT(found.size(), 100U);
  for (const Feature& f : found.features) {
    EXPECT_GT(f.left.x(), 150);
    EXPECT_FALSE(in_right.hides(f.right.cast<double>()));
  }
}

// Dim light: noise of every pixel is as strong as the ground's texture.
TEST(Features, OfNoisyImagesAreTheGroundsAndOnTheTrueSurface) {
  auto images = test::shoot(slope(), smallRig(), lookingDown(0, 0, 0, 0), 1);
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 24);
  for (auto* image : {&images.first, &images.second})
    for (std::uint8_t& p : image->pixels)
      p = static_cast<std::uint8_t>(std::clamp(100 + 0.4 * (p - 100) + noise(random), 0.0, 255.0));
  FeatureExtractor extractor(smallRig(), {});
  const FrameFeatures& frame = extractor.process(images.first.view(), images.second.view());
  const std::size_t near = nearSlope(frame);
  EXPECT_GT(near, 24U);
  EXPECT_GT(static_cast<double>(near), 0.8 * static_cast<double>(frame.size()));
}

// Ground of a few grey levels, brighter to one side, behind specks of marine snow.
TEST(Features, OfGroundOfLittleContrastAreAsManyAsOfOther) {
  auto images = test::shoot(slope(), smallRig(), lookingDown(0, 0, 0, 0), 1);
  std::mt19937 random(5);
  for (auto* image : {&images.first, &images.second}) {
    for (std::size_t k = 0; k < image->pixels.size(); ++k) {
      const double shade = 100.0 * static_cast<double>(k % 480) / 480;
      image->pixels[k] = static_cast<std::uint8_t>(60 + shade + 0.08 * (image->pixels[k] - 100));
    }
    for (int speck = 0; speck < 30; ++speck) image->pixels[random() % image->pixels.size()] = 255;
  }
  FeatureExtractor extractor(smallRig(), {});
  const FrameFeatures& frame = extractor.process(images.first.view(), images.second.view());
  const std::size_t near = nearSlope(frame);
  std::printf("%zu features, %zu near the ground\n", frame.size(), near);
  EXPECT_GT(near, 400U);
  EXPECT_GT(static_cast<double>(near), 0.99 * static_cast<double>(frame.size()));
}

TEST(Features, AreNoneForEmptyWrongOrFlatImages) {
  FeatureExtractor extractor(smallRig(), {});
  EXPECT_EQ(extractor.process({}, {}).size(), 0U);
  const std::vector<std::uint8_t> grey(480 * 384, 100);
  const ImageView flat{grey.data(), 480, 384, 480, PixelFormat::kMono, 8};
  EXPECT_EQ(extractor.process(flat, flat).size(), 0U);
  const ImageView small{grey.data(), 240, 384, 240, PixelFormat::kMono, 8};
  EXPECT_EQ(extractor.process(flat, small).size(), 0U);
  const auto images = test::shoot(slope(), smallRig(), lookingDown(0, 0, 0, 0), 1);
  EXPECT_EQ(extractor.process(images.first.view(), images.second.view(), {3.0, 2.0}).size(), 0U);
}

// The same ground from two sides, each view tilted by 50 degrees.
TEST(Features, OfAnObliqueViewAreThoseOfAViewFromAboveSoThatTheyMatchFromAllSides) {
  constexpr double kHeight = 2, kSlant = 0.87;
  const Seafloor flat{[](double, double) { return kHeight; }, test::randomTexture(0.012, 4)};
  // Moves the tilted camera back, so that its axis meets the ground at the origin.
  const auto from = [&](double yaw) {
    const SE3 there = lookingDown(0, 0, 0, yaw, 0, kSlant);
    const Eigen::Vector3d axis = there.rotation() * Eigen::Vector3d::UnitZ();
    const Eigen::Vector2d back = axis.head<2>() * (kHeight / axis.z());
    return SE3(there.rotation(), {-back.x(), -back.y(), 0});
  };
  const std::array<SE3, 2> poses = {from(0), from(3)};
  const auto inliersOf = [&](bool above) {
    std::array<FrameFeatures, 2> seen;
    for (std::size_t k = 0; k < 2; ++k) {
      const auto images = test::shoot(flat, smallRig(), poses[k], static_cast<std::uint32_t>(k));
      FeatureExtractor extractor(smallRig(), {});
      const Eigen::Vector3d down = poses[k].rotation().conjugate() * Eigen::Vector3d::UnitZ();
      seen[k] = extractor.process(images.first.view(), images.second.view(), {0.5, 10},
                                  above ? down : Eigen::Vector3d::UnitZ());
    }
    Registrar registrar(smallRig(), {});
    const Registration& found = registrar.process(seen[0], seen[1], std::nullopt);
    if (!found.accepted()) return std::size_t{0};
    EXPECT_LT((found.T_a_b.inverse() * poses[0].inverse() * poses[1]).log().norm(), 0.05);
    return found.inliers.size();
  };
  const std::size_t above = inliersOf(true), aslant = inliersOf(false);
  EXPECT_GT(above, 40U);
  EXPECT_GT(above, 4 * aslant);
}

TEST(Features, AreHardlyFoundWhereTheSeafloorIsNot) {
  const auto images = test::shoot(slope(), smallRig(), lookingDown(0, 0, 0, 0), 1);
  FeatureExtractor extractor(smallRig(), {});
  EXPECT_LT(extractor.process(images.first.view(), images.second.view(), {8.0, 12.0}).size(), 5U);
}

TEST(Features, RefuseAConfigurationOutOfRange) {
  FeatureConfig config;
  config.max_features = 0;
  EXPECT_THROW(FeatureExtractor(smallRig(), config), std::invalid_argument);
  config = {};
  config.depths = {2.0, 1.0};
  EXPECT_THROW(FeatureExtractor(smallRig(), config), std::invalid_argument);
  EXPECT_THROW(FeatureExtractor(StereoRig{}, {}), std::invalid_argument);
}

TEST(FeatureSlot, GivesBackWhatWasWritten) {
  const FrameFeatures frame = sample();
  std::vector<std::uint8_t> slot(slotBytes(700), 0xAB);
  ASSERT_TRUE(writeSlot(frame, slot));
  FrameFeatures back;
  ASSERT_TRUE(readSlot(slot, back));
  ASSERT_EQ(back.size(), frame.size());
  EXPECT_EQ(back.descriptors, frame.descriptors);
  for (std::size_t i = 0; i < frame.size(); ++i) {
    EXPECT_EQ(back.features[i].point, frame.features[i].point);
    EXPECT_EQ(back.features[i].covariance, frame.features[i].covariance);
    EXPECT_EQ(back.features[i].right, frame.features[i].right);
  }
}

TEST(FeatureSlot, RefusesASlotThatIsTooSmallAndBytesThatAreNone) {
  FrameFeatures frame = sample(), back;
  std::vector<std::uint8_t> small(slotBytes(frame.size()) - 1);
  EXPECT_FALSE(writeSlot(frame, small));

  std::vector<std::uint8_t> slot(slotBytes(frame.size()));
  ASSERT_TRUE(writeSlot(frame, slot));
  EXPECT_FALSE(readSlot({}, back));
  EXPECT_FALSE(readSlot(std::span(slot).first(slot.size() - 1), back));
  for (const std::size_t byte : {0U, 4U, 5U}) {  // magic, kind, zero
    std::vector<std::uint8_t> bad = slot;
    bad[byte] = 0xEE;
    EXPECT_FALSE(readSlot(bad, back)) << byte;
  }
  frame.features[3].point.x() = std::numeric_limits<float>::quiet_NaN();
  ASSERT_TRUE(writeSlot(frame, slot));
  EXPECT_FALSE(readSlot(slot, back));
  EXPECT_EQ(back.size(), 0U);
}

TEST(FeatureSlot, HoldsAnEmptyFrame) {
  std::vector<std::uint8_t> slot(slotBytes(0));
  FrameFeatures none, back;
  ASSERT_TRUE(writeSlot(none, slot));
  EXPECT_TRUE(readSlot(slot, back));
  EXPECT_EQ(back.size(), 0U);
}

// Values as descriptors have them, the largest among them.
std::vector<std::int16_t> vectors(int count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<std::int16_t> values(static_cast<std::size_t>(count) * kDotLength);
  for (std::int16_t& v : values) v = static_cast<std::int16_t>(random() % 256);
  for (std::size_t k = 0; k < kDotLength && !values.empty(); ++k) values[k] = 255;
  return values;
}

TEST(DotProducts, AreExactInEveryInstructionSetForAnyNumberOfVectors) {
  for (const auto& [n, m] : {std::pair{0, 5}, {5, 0}, {1, 1}, {3, 4}, {7, 9}, {33, 34}}) {
    const auto x = vectors(n, 1), y = vectors(m, 2);
    std::vector<float> expected(static_cast<std::size_t>(n * m)), fastest(expected), baseline(expected);
    for (int j = 0; j < m; ++j)
      for (int i = 0; i < n; ++i) {
        long sum = 0;
        for (int k = 0; k < kDotLength; ++k)
          sum += static_cast<long>(x[static_cast<std::size_t>(kDotLength * i + k)]) *
                 y[static_cast<std::size_t>(kDotLength * j + k)];
        expected[static_cast<std::size_t>(i + n * j)] = static_cast<float>(sum);
      }
    fastestDotProducts()(x.data(), n, y.data(), m, fastest.data());
    baselineDotProducts()(x.data(), n, y.data(), m, baseline.data());
    EXPECT_EQ(fastest, expected) << n << " x " << m;
    EXPECT_EQ(baseline, expected) << n << " x " << m;
  }
}

}  // namespace
}  // namespace fathom::closure
