#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <random>
#include <stdexcept>
#include <vector>

#include "recon/lighting/colour_light.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "tests/support/strip_mask.hpp"
#include "tests/world/light_dives.hpp"

namespace fathom::lighting {
namespace {

using namespace test;

class LightingModelOfBits : public testing::TestWithParam<int> {};

TEST_P(LightingModelOfBits, VignettedImagesBecomeFlatWithTheTargetMeanAndSpread) {
  SyntheticStrobeDive dive(PixelFormat::kMono, GetParam());
  const auto images = correctDive(dive, PixelFormat::kMono, GetParam(), 60, 60);
  for (const StrobeBox& box : kCornersAndCentre) {
    const auto [mean, sigma] = statistics(images, box, kEveryPixel);
    EXPECT_NEAR(mean, 0.42, 0.015) << box.x0 << ' ' << box.y0;
    EXPECT_NEAR(sigma, 0.13, 0.015) << box.x0 << ' ' << box.y0;
  }
}

INSTANTIATE_TEST_SUITE_P(EightToSixteen, LightingModelOfBits, testing::Values(8, 9, 10, 12, 13, 16));

TEST(LightingModel, ColoursOfABayerMosaicAreBalancedEverywhere) {
  SyntheticStrobeDive dive(PixelFormat::kBayerRggb, 12);
  const auto images = correctDive(dive, PixelFormat::kBayerRggb, 12, 60, 60);
  for (const StrobeBox& box : kCornersAndCentre)
    for (int colour = 0; colour < 3; ++colour) {
      const auto [mean, sigma] =
          statistics(images, box, [&](int x, int y) { return colourAt(x, y) == colour; });
      EXPECT_NEAR(mean, 0.42, 0.02) << colour;
      EXPECT_NEAR(sigma, 0.13, 0.02) << colour;
    }
}

TEST(LightingModel, ColoursOfAnRgbImageAreBalanced) {
  SyntheticStrobeDive dive(PixelFormat::kRgb, 8);
  const auto images = correctDive(dive, PixelFormat::kRgb, 8, 60, 60);
  for (int colour = 0; colour < 3; ++colour) {
    const auto [mean, sigma] = statistics(images, {100, 80, 160, 120}, kEveryPixel, 3, colour);
    EXPECT_NEAR(mean, 0.42, 0.02) << colour;
    EXPECT_NEAR(sigma, 0.13, 0.02) << colour;
  }
}

double srgb(double linear) {
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

// A floor with much variation of red and little of blue: stretched to one spread, a red patch would turn pink
// here and mint there.
TEST(LightingModel, ColourIsLightOverItsMeanWhateverThePatternAndTheOtherPatches) {
  constexpr std::array<double, 3> kSigma = {0.45, 0.25, 0.1};
  std::mt19937 random(9);
  const auto picture = [&](const std::array<double, 3>* albedo) {
    constexpr int kPatch = 5;  // [px]
    StrobePicture out{PixelFormat::kBayerRggb, 12, {}, {}};
    std::normal_distribution<double> normal(0, 1);
    std::vector<std::array<double, 3>> floor((kStrobeWidth / kPatch + 1) * (kStrobeHeight / kPatch + 1));
    for (auto& patch : floor)
      for (std::size_t c = 0; c < 3; ++c) patch[c] = std::max(1 + kSigma[c] * normal(random), 0.0);
    for (int y = 0; y < kStrobeHeight; ++y)
      for (int x = 0; x < kStrobeWidth; ++x) {
        const auto c = static_cast<std::size_t>(colourAt(x, y));
        const double r =
            albedo != nullptr
                ? (*albedo)[c]
                : floor[static_cast<std::size_t>(y / kPatch * (kStrobeWidth / kPatch) + x / kPatch)][c];
        out.words.push_back(static_cast<std::uint16_t>(
            std::lround(std::clamp(kWater[c] * strobe(x, y) * r, 0.0, 1.0) * 4095)));
      }
    return out;
  };
  LightingModel model(kStrobeWidth, kStrobeHeight, PixelFormat::kBayerRggb, 12, kStrobeConfig);
  for (int i = 0; i < 150; ++i) model.add(picture(nullptr).view());
  const double grey = std::pow((0.42 + 0.055) / 1.055, 2.4);  // target_mean
  for (const std::array<double, 3>& albedo : {std::array{1.3, 0.8, 1.05}, std::array{0.5, 0.9, 1.1}}) {
    std::vector<std::uint8_t> out(kStrobeWidth * kStrobeHeight);
    model.correctColour(picture(&albedo).view(), RangeLattice(), out.data());
    for (const StrobeBox& box : kCornersAndCentre)
      for (std::size_t c = 0; c < 3; ++c) {
        const auto [mean, sigma] =
            statistics({out}, box, [&](int x, int y) { return colourAt(x, y) == static_cast<int>(c); });
        EXPECT_NEAR(mean, srgb(grey * albedo[c]), 0.012) << c << ' ' << box.x0 << ' ' << box.y0;
        EXPECT_FALSE(sigma > 0.012);
      }
  }
}

TEST(LightingModel, ADarkerPictureOfSrgbHasTheSameColoursByItsGainInLight) {
  SyntheticStrobeDive dive(PixelFormat::kRgb, 8);
  LightingModel model(kStrobeWidth, kStrobeHeight, PixelFormat::kRgb, 8, kStrobeConfig);
  for (int i = 0; i < 60; ++i) model.add(dive.next().view());
  const StrobePicture bright = dive.next();
  StrobePicture dark = bright;
  constexpr double kGain = 0.7;
  const auto linear = [](double s) { return s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4); };
  for (std::uint8_t& level : dark.bytes)
    level = static_cast<std::uint8_t>(std::lround(255 * srgb(kGain * linear(level / 255.0))));
  std::vector<std::uint8_t> expected(3 * kStrobeWidth * kStrobeHeight), out(expected.size());
  model.correctColour(bright.view(), RangeLattice(), expected.data());
  model.correctColour(dark.view(), RangeLattice(), out.data(), {.gain = kGain});
  const auto [mean, sigma] = statistics({out}, {0, 0, kStrobeWidth, kStrobeHeight}, kEveryPixel, 3, 1);
  const auto [mean_expected, sigma_expected] =
      statistics({expected}, {0, 0, kStrobeWidth, kStrobeHeight}, kEveryPixel, 3, 1);
  EXPECT_NEAR(mean, mean_expected, 0.02);
  EXPECT_NEAR(sigma, sigma_expected, 0.02);
}

TEST(CorrectRows, LinearLightIsEncodedAsSrgb) {
  constexpr int kLevels = 4096;
  const RowPlan plan(kLevels, 2);
  std::vector<std::uint16_t> in(kLevels);
  std::iota(in.begin(), in.end(), std::uint16_t{0});
  const Correction nodes[] = {{1.0F / (kLevels - 1), 0}, {1.0F / (kLevels - 1), 0}};
  std::vector<std::uint8_t> out(kLevels);
  correctRow<Encoding::kSrgb>(plan, in.data(), nodes, nodes, out.data());
  for (int k = 0; k < kLevels; ++k) {
    const double expected = 255 * srgb(static_cast<double>(k) / (kLevels - 1));
    EXPECT_NEAR(out[static_cast<std::size_t>(k)], expected, k < 20 ? 3.0 : 1.0) << k;
  }
}

TEST(LightingModel, FewImagesAlreadyRemoveTheStrobesPattern) {
  SyntheticStrobeDive dive(PixelFormat::kMono, 12);
  const auto images = correctDive(dive, PixelFormat::kMono, 12, 8, 60);
  for (const StrobeBox& box : kCornersAndCentre)
    EXPECT_NEAR(statistics(images, box, kEveryPixel)[0], 0.42, 0.04);
}

TEST(LightingModel, SaturatedSamplesDoNotEnterTheStatistics) {
  SyntheticStrobeDive dive(PixelFormat::kMono, 12);
  dive.setHot(true);
  LightingModel model(kStrobeWidth, kStrobeHeight, PixelFormat::kMono, 12, kStrobeConfig);
  for (int i = 0; i < 60; ++i) model.add(dive.next().view());
  dive.setHot(false);
  std::vector<std::vector<std::uint8_t>> images;
  for (int i = 0; i < 60; ++i) {
    images.emplace_back(kStrobeWidth * kStrobeHeight);
    model.correct(dive.next().view(), images.back().data());
  }
  const auto [mean, sigma] = statistics(images, {70, 50, 90, 70}, kEveryPixel);
  EXPECT_NEAR(mean, 0.42, 0.02);
  EXPECT_NEAR(sigma, 0.13, 0.02);
}

TEST(LightingModel, BeforeEnoughImagesTheWholeImageSharesOneCorrection) {
  SyntheticStrobeDive dive(PixelFormat::kMono, 12);
  const auto images = correctDive(dive, PixelFormat::kMono, 12, 3, 40);
  EXPECT_NEAR(statistics(images, {0, 0, kStrobeWidth, kStrobeHeight}, kEveryPixel)[0], 0.42, 0.03);
  // The strobe's pattern stays, for the pattern is not known yet.
  EXPECT_GT(statistics(images, {30, 20, 60, 50}, kEveryPixel)[0], 0.45);
  EXPECT_LT(statistics(images, {130, 90, 160, 120}, kEveryPixel)[0], 0.38);
}

TEST(LightingModel, BeforeTheFirstImageFullScaleBecomes255) {
  const LightingModel model(4, 2, PixelFormat::kMono, 12, {});
  const std::vector<std::uint16_t> samples = {0, 16, 2048, 4095, 4095, 1024, 8, 0};
  std::vector<std::uint8_t> out(8);
  model.correct({samples.data(), 4, 2, 8, PixelFormat::kMono, 12}, out.data());
  EXPECT_EQ(out, (std::vector<std::uint8_t>{0, 1, 128, 255, 255, 64, 0, 0}));
}

TEST(LightingModel, WronglyShapedImagesAreIgnoredCountedAndCorrectedToBlack) {
  LightingModel model(kStrobeWidth, kStrobeHeight, PixelFormat::kMono, 12, {});
  const StrobePicture picture = SyntheticStrobeDive(PixelFormat::kMono, 12).next();
  ImageView view = picture.view();
  model.add(view);
  model.add({});
  view.bits = 16;
  model.add(view);
  view = picture.view();
  view.format = PixelFormat::kBayerRggb;
  model.add(view);
  view = picture.view();
  view.stride = kStrobeWidth;
  model.add(view);
  EXPECT_EQ(model.images(), 1);
  EXPECT_EQ(model.ignoredImages(), 4U);
  std::vector<std::uint8_t> out(kStrobeWidth * kStrobeHeight, 7);
  model.correct({}, out.data());
  EXPECT_EQ(std::count(out.begin(), out.end(), 0), kStrobeWidth * kStrobeHeight);
}

TEST(LightingModel, ImagesOfOneValueOrOddSizeAreCorrectedWithoutHarm) {
  for (const PixelFormat format : {PixelFormat::kMono, PixelFormat::kBayerRggb}) {
    LightingModel model(7, 5, format, 8, {});
    const std::vector<std::uint8_t> black(35, 0), white(35, 255);
    std::vector<std::uint8_t> out(35);
    for (int i = 0; i < 20; ++i) model.add({black.data(), 7, 5, 7, format, 8});
    model.correct({black.data(), 7, 5, 7, format, 8}, out.data());
    EXPECT_EQ(std::count(out.begin(), out.end(), 107), 35);
    LightingModel bright(7, 5, format, 8, {});
    for (int i = 0; i < 20; ++i) bright.add({white.data(), 7, 5, 7, format, 8});
    bright.correct({white.data(), 7, 5, 7, format, 8}, out.data());
    EXPECT_EQ(std::count(out.begin(), out.end(), 255), 35);
  }
}

TEST(LightingModel, ImpossibleShapesAndConfigurationsAreRefused) {
  const auto make = [](int width, int height, PixelFormat format, int bits,
                       const LightingConfig& config = {}) {
    LightingModel model(width, height, format, bits, config);
  };
  EXPECT_THROW(make(0, 5, PixelFormat::kMono, 8), std::invalid_argument);
  EXPECT_THROW(make(1, 1, PixelFormat::kBayerRggb, 8), std::invalid_argument);
  EXPECT_THROW(make(5, 5, PixelFormat::kMono, 7), std::invalid_argument);
  EXPECT_THROW(make(5, 5, PixelFormat::kMono, 17), std::invalid_argument);
  LightingConfig config{.grid = 0};
  EXPECT_THROW(make(5, 5, PixelFormat::kMono, 8, config), std::invalid_argument);
  config = {};
  config.target_sigma = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(make(5, 5, PixelFormat::kMono, 8, config), std::invalid_argument);
}

// Bright objects in every image, once visible and once hidden.
TEST(LightingModel, LearnsNothingFromWhatAMaskHides) {
  const ImageMask mask = fathom::test::stripMask(kStrobeWidth, kStrobeHeight, 60, 79);
  for (const PixelFormat format : {PixelFormat::kMono, PixelFormat::kBayerRggb, PixelFormat::kRgb}) {
    const std::size_t channels = format == PixelFormat::kRgb ? 3 : 1;
    double means[2];
    for (const bool hidden : {false, true}) {
      SyntheticStrobeDive dive(format, 8);
      LightingModel model(kStrobeWidth, kStrobeHeight, format, 8, kStrobeConfig);
      const auto next = [&] {
        StrobePicture picture = dive.next();
        for (std::size_t y = 0; y < kStrobeHeight; ++y)
          std::fill_n(picture.bytes.begin() + static_cast<std::ptrdiff_t>((y * kStrobeWidth + 60) * channels),
                      20 * channels, 245);
        return picture;
      };
      for (int i = 0; i < 40; ++i) {
        const StrobePicture picture = next();
        ImageView view = picture.view();
        if (hidden) view.mask = &mask;
        model.add(view);
      }
      std::vector<std::vector<std::uint8_t>> corrected(1);
      corrected[0].resize(kStrobeWidth * kStrobeHeight * channels);
      model.correct(next().view(), corrected[0].data());
      means[hidden ? 1 : 0] =
          statistics(corrected, {64, 40, 76, 80}, kEveryPixel, static_cast<int>(channels))[0];
    }
    EXPECT_LT(means[0], 0.85) << static_cast<int>(format);  // learnt as seafloor
    EXPECT_GT(means[1], 0.9) << static_cast<int>(format);
  }
}

}  // namespace
}  // namespace fathom::lighting
