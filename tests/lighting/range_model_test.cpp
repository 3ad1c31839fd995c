#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "recon/lighting/lighting_model.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/world/light_dives.hpp"

namespace fathom::lighting {
namespace {

using namespace test;

LightingModel makeModel(LightingChoice choice = LightingChoice::kAuto) {
  LightingConfig config{.grid = 8};
  config.choice = choice;
  return {kRangeWidth, kRangeHeight, PixelFormat::kMono, 12, config};
}

// Across a drop-off: first the reef at 2 m, then 5 m down, coming up to 2.5 m.
std::vector<double> dropOff() {
  std::vector<double> altitudes(50, 2.0);
  for (int k = 0; k < 40; ++k) altitudes.push_back(5.0 - 2.5 * k / 39);
  return altitudes;
}

void learnAltitudes(LightingModel& model, const std::vector<double>& altitudes, unsigned seed = 3) {
  SyntheticRangeDive scene(seed);
  for (const double altitude : altitudes)
    model.add(SyntheticRangeDive::view(scene.textured(altitude)), SyntheticRangeDive::ranges(altitude));
}

// An even floor, corrected: brightness by pixel, in parts of full scale.
std::vector<double> correctedEven(const LightingModel& model, double altitude) {
  SyntheticRangeDive scene(9);
  const auto picture = scene.even(altitude);
  std::vector<std::uint8_t> out(picture.size());
  model.correct(SyntheticRangeDive::view(picture), SyntheticRangeDive::ranges(altitude), out.data());
  std::vector<double> parts;
  for (const std::uint8_t v : out) parts.push_back(v / 255.0);
  return parts;
}

// Rms difference between corrected images of the same even floor from two altitudes: the step at
// their overlap.
double step(const LightingModel& model, double a, double b) {
  const auto at_a = correctedEven(model, a), at_b = correctedEven(model, b);
  double sum = 0;
  for (std::size_t k = 0; k < at_a.size(); ++k) sum += (at_a[k] - at_b[k]) * (at_a[k] - at_b[k]);
  return std::sqrt(sum / static_cast<double>(at_a.size()));
}

TEST(RangeModel, IsChosenOverADropOffAndAtLeastHalvesThePlainOnesStep) {
  LightingModel automatic = makeModel(), plain = makeModel(LightingChoice::kPlain);
  learnAltitudes(automatic, dropOff());
  learnAltitudes(plain, dropOff());
  EXPECT_EQ(automatic.used(), LightingKind::kRangeDependent);
  EXPECT_EQ(plain.used(), LightingKind::kPlain);
  for (const auto& [a, b] : {std::pair(2.0, 3.0), std::pair(2.5, 4.0), std::pair(2.0, 4.8)}) {
    EXPECT_LT(step(automatic, a, b), 0.5 * step(plain, a, b)) << a << ' ' << b;
    EXPECT_LT(step(automatic, a, b), 0.07) << a << ' ' << b;
  }
}

TEST(RangeModel, CorrectedFloorHasTheTargetMeanAtEveryAltitude) {
  LightingModel model = makeModel();
  learnAltitudes(model, dropOff());
  for (const double altitude : {2.0, 2.7, 3.5, 4.5}) {
    const auto parts = correctedEven(model, altitude);
    constexpr int kBox = 10;  // [px]: noise averages out
    double mean = 0, worst = 0;
    for (int y0 = 0; y0 < kRangeHeight; y0 += kBox)
      for (int x0 = 0; x0 < kRangeWidth; x0 += kBox) {
        double box = 0;
        for (int y = y0; y < y0 + kBox; ++y)
          for (int x = x0; x < x0 + kBox; ++x)
            box += parts[static_cast<std::size_t>(y * kRangeWidth + x)] / (kBox * kBox);
        mean += box * kBox * kBox / (kRangeWidth * kRangeHeight);
        worst = std::max(worst, std::abs(box - 0.42));
      }
    EXPECT_NEAR(mean, 0.42, 0.04) << altitude;
    EXPECT_LT(worst, 0.15) << altitude;  // little more than the texture's deviation, at the image's edge
  }
}

TEST(RangeModel, CarriesThePatternToRangesWithOneImageOnly) {
  std::vector<double> altitudes(60, 2.0);
  for (int k = 0; k < 20; ++k) altitudes.push_back(2.0 + 0.05 * k);
  altitudes.push_back(3.6);
  LightingModel model = makeModel(LightingChoice::kRangeDependent), plain = makeModel(LightingChoice::kPlain);
  learnAltitudes(model, altitudes);
  learnAltitudes(plain, altitudes);
  EXPECT_LT(step(model, 2.0, 3.6), 0.10);
  EXPECT_LT(step(model, 2.0, 3.6), 0.5 * step(plain, 2.0, 3.6));
}

TEST(RangeModel, IsNotChosenWhereTheAltitudeStays) {
  LightingModel model = makeModel();
  learnAltitudes(model, std::vector<double>(60, 2.0));
  EXPECT_EQ(model.used(), LightingKind::kPlain);
  const auto report = model.report();
  EXPECT_GT(report.error_whole, 1.2 * report.error_plain);
}

TEST(RangeModel, ReportsTheLawOfRangeThatTheWaterHas) {
  LightingModel model = makeModel();
  learnAltitudes(model, dropOff());
  const Attenuation fitted = model.report().attenuation[0];
  const auto seen = [](int x, int y, double altitude) {
    return 0.6 * SyntheticRangeDive::light(x, y, altitude) + SyntheticRangeDive::veil(altitude);
  };
  // Between 2 and 4.5 m the law must lose light as the scene does, over the image.
  double lost = 0, nearer = 0, further = 0;
  for (int y = 0; y < kRangeHeight; ++y)
    for (int x = 0; x < kRangeWidth; ++x) {
      lost += std::log(seen(x, y, 4.5) / seen(x, y, 2.0)) / (kRangeWidth * kRangeHeight);
      nearer += SyntheticRangeDive::range(x, y, 2.0) / (kRangeWidth * kRangeHeight);
      further += SyntheticRangeDive::range(x, y, 4.5) / (kRangeWidth * kRangeHeight);
    }
  EXPECT_NEAR(fitted.power * std::log(further / nearer) - fitted.per_metre * (further - nearer), lost, 0.15);
}

// Half of the first images, too: there is nothing else to go by then but the law of range. Something in a
// corner may shine by itself.
TEST(RangeModel, LearnsNothingFromStrobesThatStayedDark) {
  LightingModel model = makeModel(), lit = makeModel();
  const std::vector<double> altitudes = dropOff();
  SyntheticRangeDive scene(3);
  std::vector<std::uint16_t> dark(kRangeWidth * kRangeHeight, 0);
  dark.front() = 2000;
  std::uint64_t unlit = 0;
  for (std::size_t k = 0; k < altitudes.size(); ++k) {
    const auto picture = scene.textured(altitudes[k]);
    lit.add(SyntheticRangeDive::view(picture), SyntheticRangeDive::ranges(altitudes[k]));
    model.add(SyntheticRangeDive::view(picture), SyntheticRangeDive::ranges(altitudes[k]));
    if (k % 2 == 1 && k > 20) continue;
    model.add(SyntheticRangeDive::view(dark), SyntheticRangeDive::ranges(altitudes[k]));
    ++unlit;
  }
  EXPECT_EQ(lit.ignoredImages(), 0U);
  EXPECT_EQ(model.ignoredImages(), unlit);
  for (const double altitude : {1.5, 2.0, 3.0}) {
    const auto at = SyntheticRangeDive::ranges(altitude);
    const auto picture = scene.textured(altitude);
    EXPECT_TRUE(model.unlit(SyntheticRangeDive::view(dark), at)) << altitude;
    EXPECT_FALSE(model.unlit(SyntheticRangeDive::view(picture), at)) << altitude;
  }
  EXPECT_EQ(correctedEven(model, 3.0), correctedEven(lit, 3.0));
}

TEST(RangeModel, WithoutRangesThePlainOneStandsIn) {
  LightingModel model = makeModel(), plain = makeModel(LightingChoice::kPlain);
  learnAltitudes(model, dropOff());
  learnAltitudes(plain, dropOff());
  SyntheticRangeDive scene(9);
  const auto picture = scene.textured(2.0);
  std::vector<std::uint8_t> with(picture.size()), without(picture.size()), unknown(picture.size());
  plain.correct(SyntheticRangeDive::view(picture), with.data());
  model.correct(SyntheticRangeDive::view(picture), without.data());
  RangeLattice nowhere;
  nowhere.path.fill(std::numeric_limits<float>::quiet_NaN());
  model.correct(SyntheticRangeDive::view(picture), nowhere, unknown.data());
  EXPECT_EQ(with, without);
  EXPECT_EQ(with, unknown);
}

TEST(RangeModel, ImagesWithoutRangesTeachThePlainModelAlone) {
  LightingModel model = makeModel(LightingChoice::kRangeDependent);
  SyntheticRangeDive scene(3);
  for (int k = 0; k < 20; ++k) model.add(SyntheticRangeDive::view(scene.textured(2.0)));
  EXPECT_EQ(model.used(), LightingKind::kPlain);
  EXPECT_LT(model.report().error_range, 0);
}

TEST(LightingModelMemory, AddAndCorrectAllocateNothing) {
  SyntheticRangeDive scene(3);
  std::vector<std::vector<std::uint16_t>> pictures;
  for (int k = 0; k < 30; ++k) pictures.push_back(scene.textured(2.0 + 0.1 * k));
  LightingModel model = makeModel();
  std::vector<std::uint8_t> out(kRangeWidth * kRangeHeight);
  const std::size_t bytes = model.report().memory_bytes;
  const auto before = fathom::test::threadCost();
  for (std::size_t k = 0; k < pictures.size(); ++k) {
    const RangeLattice range = SyntheticRangeDive::ranges(2.0 + 0.1 * static_cast<double>(k));
    model.add(SyntheticRangeDive::view(pictures[k]), range);
    model.correct(SyntheticRangeDive::view(pictures[k]), range, out.data());
    model.correct(SyntheticRangeDive::view(pictures[k]), out.data());
  }
  EXPECT_EQ((fathom::test::threadCost() - before).heap_calls, 0U);
  EXPECT_EQ(model.report().memory_bytes, bytes);
}

TEST(LightingModelColour, IsTheMissionsAndNotAnImages) {
  LightingModel model = makeModel();
  learnAltitudes(model, dropOff());
  SyntheticRangeDive scene(9);
  auto picture = scene.textured(3.0);
  std::vector<std::uint8_t> as_it_is(picture.size()), beside_white(picture.size());
  model.correct(SyntheticRangeDive::view(picture), SyntheticRangeDive::ranges(3.0), as_it_is.data());
  const auto half = static_cast<std::ptrdiff_t>(picture.size() / 2);
  std::fill(picture.begin() + half, picture.end(), std::uint16_t{4095});
  model.correct(SyntheticRangeDive::view(picture), SyntheticRangeDive::ranges(3.0), beside_white.data());
  EXPECT_TRUE(std::equal(as_it_is.begin(), as_it_is.begin() + half, beside_white.begin()));
}

constexpr double kAltitude = 2.0;  // [m]

// The mean and standard deviation of each pixel over all images, by Welford's recurrence: the reference.
struct PixelWelford {
  std::vector<double> mean = std::vector<double>(kRangeWidth * kRangeHeight), squares = mean;
  int images = 0;
  void add(const std::vector<std::uint16_t>& picture) {
    ++images;
    for (std::size_t k = 0; k < picture.size(); ++k) {
      const double value = picture[k] / 4095.0, delta = value - mean[k];
      mean[k] += delta / images;
      squares[k] += delta * (value - mean[k]);
    }
  }
  double correct(std::size_t k, double value) const {
    return 0.42 + 0.13 * (value - mean[k]) / std::sqrt(squares[k] / (images - 1));
  }
};

void paint(std::vector<std::uint16_t>& picture, int x0, int y0, int width, int height, double factor) {
  for (int y = std::max(y0, 0); y < std::min(y0 + height, kRangeHeight); ++y)
    for (int x = std::max(x0, 0); x < std::min(x0 + width, kRangeWidth); ++x) {
      std::uint16_t& v = picture[static_cast<std::size_t>(y * kRangeWidth + x)];
      v = static_cast<std::uint16_t>(std::min(factor * v, 3900.0));
    }
}

struct Region {
  int x0, y0, x1, y1;
};

// How far the mean of corrected images of an even floor is off the target in a region.
template <typename Correct>
double offTarget(const Region& region, Correct correct) {
  SyntheticRangeDive scene(9);
  const auto picture = scene.even(kAltitude);
  double sum = 0, count = 0;
  for (int y = region.y0; y < region.y1; ++y)
    for (int x = region.x0; x < region.x1; ++x) {
      const auto k = static_cast<std::size_t>(y * kRangeWidth + x);
      sum += correct(k, picture[k]);
      count += 1;
    }
  return std::abs(sum / count - 0.42);
}

// A bright fish, always in the same part of the image, in one image of ten, from the first on; a shadow in
// another part in as many.
TEST(LightingOutliers, AFishAndAShadowInATenthOfTheImagesLeaveThePatternAlone) {
  constexpr Region kFish{100, 20, 140, 50}, kShadow{20, 70, 60, 100};
  LightingModel model(kRangeWidth, kRangeHeight, PixelFormat::kMono, 12, {.grid = 8});
  PixelWelford reference;
  SyntheticRangeDive scene(3);
  for (int k = 0; k < 80; ++k) {
    auto picture = scene.textured(kAltitude);
    if (k % 10 == 0) paint(picture, kFish.x0, kFish.y0, 40, 30, 6.0);
    if (k % 10 == 5) paint(picture, kShadow.x0, kShadow.y0, 40, 30, 0.1);
    model.add(SyntheticRangeDive::view(picture), SyntheticRangeDive::ranges(kAltitude));
    reference.add(picture);
  }
  SyntheticRangeDive scene_again(9);
  const auto even = scene_again.even(kAltitude);
  std::vector<std::uint8_t> out(even.size());
  model.correct(SyntheticRangeDive::view(even), SyntheticRangeDive::ranges(kAltitude), out.data());
  const auto ours = [&](std::size_t k, std::uint16_t) { return out[k] / 255.0; };
  const auto plain = [&](std::size_t k, std::uint16_t v) { return reference.correct(k, v / 4095.0); };

  EXPECT_LT(offTarget(kFish, ours), 0.015);
  EXPECT_GT(offTarget(kFish, plain), 0.03);
  EXPECT_LT(offTarget(kShadow, ours), 0.015);
  const double share = model.report().outlier_share;
  const double painted = 0.1 * 2 * 40 * 30 / (kRangeWidth * kRangeHeight);
  EXPECT_GT(share, 0.5 * painted);
  EXPECT_LT(share, 2.5 * painted);

  // The spread of the texture is kept, too: the reference's is three times too wide under the fish.
  SyntheticRangeDive other(17);
  double n = 0, sum = 0, squares = 0, plain_sum = 0, plain_squares = 0;
  for (int k = 0; k < 20; ++k) {
    const auto picture = other.textured(kAltitude);
    model.correct(SyntheticRangeDive::view(picture), SyntheticRangeDive::ranges(kAltitude), out.data());
    for (int y = kFish.y0; y < kFish.y1; ++y)
      for (int x = kFish.x0; x < kFish.x1; ++x) {
        const auto at = static_cast<std::size_t>(y * kRangeWidth + x);
        const double v = out[at] / 255.0, p = plain(at, picture[at]);
        n += 1, sum += v, squares += v * v, plain_sum += p, plain_squares += p * p;
      }
  }
  EXPECT_NEAR(std::sqrt(squares / n - sum * sum / n / n), 0.13, 0.025);
  EXPECT_LT(std::sqrt(plain_squares / n - plain_sum * plain_sum / n / n), 0.08);
}

TEST(LightingOutliers, ACleanDiveLosesNextToNothing) {
  LightingModel model(kRangeWidth, kRangeHeight, PixelFormat::kMono, 12, {.grid = 8});
  SyntheticRangeDive scene(3);
  for (int k = 0; k < 40; ++k) model.add(SyntheticRangeDive::view(scene.textured(kAltitude)));
  EXPECT_LT(model.report().outlier_share, 0.015);
}

}  // namespace
}  // namespace fathom::lighting
