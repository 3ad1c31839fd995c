#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "recon/lighting/lighting_model.hpp"
#include "tests/lighting/dive_scene.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::lighting {
namespace {

using test::DiveScene;
using test::kHeight;
using test::kWidth;

LightingModel makeModel(LightingChoice choice = LightingChoice::kAuto) {
  LightingConfig config{.grid = 8};
  config.choice = choice;
  return {kWidth, kHeight, PixelFormat::kMono, 12, config};
}

// Across a drop-off: first the reef at 2 m, then 5 m down, coming up to 2.5 m.
std::vector<double> dropOff() {
  std::vector<double> altitudes(50, 2.0);
  for (int k = 0; k < 40; ++k) altitudes.push_back(5.0 - 2.5 * k / 39);
  return altitudes;
}

void learn(LightingModel& model, const std::vector<double>& altitudes, unsigned seed = 3) {
  DiveScene scene(seed);
  for (const double altitude : altitudes)
    model.add(DiveScene::view(scene.textured(altitude)), DiveScene::ranges(altitude));
}

// An even floor, corrected: brightness by pixel, in parts of full scale.
std::vector<double> correctedEven(const LightingModel& model, double altitude) {
  DiveScene scene(9);
  const auto picture = scene.even(altitude);
  std::vector<std::uint8_t> out(picture.size());
  model.correct(DiveScene::view(picture), DiveScene::ranges(altitude), out.data());
  std::vector<double> parts;
  for (const std::uint8_t v : out) parts.push_back(v / 255.0);
  return parts;
}

// Rms difference of what two altitudes make of the same even floor: the step where their images overlap.
double step(const LightingModel& model, double a, double b) {
  const auto at_a = correctedEven(model, a), at_b = correctedEven(model, b);
  double sum = 0;
  for (std::size_t k = 0; k < at_a.size(); ++k) sum += (at_a[k] - at_b[k]) * (at_a[k] - at_b[k]);
  return std::sqrt(sum / static_cast<double>(at_a.size()));
}

TEST(RangeModel, IsChosenOverADropOffAndAtLeastHalvesThePlainOnesStep) {
  LightingModel automatic = makeModel(), plain = makeModel(LightingChoice::kPlain);
  learn(automatic, dropOff());
  learn(plain, dropOff());
  EXPECT_EQ(automatic.used(), LightingKind::kRangeDependent);
  EXPECT_EQ(plain.used(), LightingKind::kPlain);
  for (const auto& [a, b] : {std::pair(2.0, 3.0), std::pair(2.5, 4.0), std::pair(2.0, 4.8)}) {
    EXPECT_LT(step(automatic, a, b), 0.5 * step(plain, a, b)) << a << ' ' << b;
    EXPECT_LT(step(automatic, a, b), 0.07) << a << ' ' << b;
  }
}

TEST(RangeModel, CorrectedFloorHasTheTargetMeanAtEveryAltitude) {
  LightingModel model = makeModel();
  learn(model, dropOff());
  for (const double altitude : {2.0, 2.7, 3.5, 4.5}) {
    const auto parts = correctedEven(model, altitude);
    constexpr int kBox = 10;  // [px]: noise averages out
    double mean = 0, worst = 0;
    for (int y0 = 0; y0 < kHeight; y0 += kBox)
      for (int x0 = 0; x0 < kWidth; x0 += kBox) {
        double box = 0;
        for (int y = y0; y < y0 + kBox; ++y)
          for (int x = x0; x < x0 + kBox; ++x)
            box += parts[static_cast<std::size_t>(y * kWidth + x)] / (kBox * kBox);
        mean += box * kBox * kBox / (kWidth * kHeight);
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
  learn(model, altitudes);
  learn(plain, altitudes);
  EXPECT_LT(step(model, 2.0, 3.6), 0.10);
  EXPECT_LT(step(model, 2.0, 3.6), 0.5 * step(plain, 2.0, 3.6));
}

TEST(RangeModel, IsNotChosenWhereTheAltitudeStays) {
  LightingModel model = makeModel();
  learn(model, std::vector<double>(60, 2.0));
  EXPECT_EQ(model.used(), LightingKind::kPlain);
  const auto report = model.report();
  EXPECT_GT(report.error_whole, 1.2 * report.error_plain);
}

TEST(RangeModel, ReportsTheLawOfRangeThatTheWaterHas) {
  LightingModel model = makeModel();
  learn(model, dropOff());
  const Attenuation fitted = model.report().attenuation[0];
  const auto seen = [](int x, int y, double altitude) {
    return 0.6 * DiveScene::light(x, y, altitude) + DiveScene::veil(altitude);
  };
  // Between 2 and 4.5 m the law must lose light as the scene does, over the image.
  double lost = 0, nearer = 0, further = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      lost += std::log(seen(x, y, 4.5) / seen(x, y, 2.0)) / (kWidth * kHeight);
      nearer += DiveScene::range(x, y, 2.0) / (kWidth * kHeight);
      further += DiveScene::range(x, y, 4.5) / (kWidth * kHeight);
    }
  EXPECT_NEAR(fitted.power * std::log(further / nearer) - fitted.per_metre * (further - nearer), lost, 0.15);
}

// Half of the first images, too: there is nothing else to go by then but the law of range.
TEST(RangeModel, LearnsNothingFromStrobesThatStayedDark) {
  LightingModel model = makeModel(), lit = makeModel();
  const std::vector<double> altitudes = dropOff();
  DiveScene scene(3);
  const std::vector<std::uint16_t> dark(kWidth * kHeight, 0);
  std::uint64_t unlit = 0;
  for (std::size_t k = 0; k < altitudes.size(); ++k) {
    const auto picture = scene.textured(altitudes[k]);
    lit.add(DiveScene::view(picture), DiveScene::ranges(altitudes[k]));
    model.add(DiveScene::view(picture), DiveScene::ranges(altitudes[k]));
    if (k % 2 == 1 && k > 20) continue;
    model.add(DiveScene::view(dark), DiveScene::ranges(altitudes[k]));
    ++unlit;
  }
  EXPECT_EQ(lit.ignoredImages(), 0U);
  EXPECT_EQ(model.ignoredImages(), unlit);
  EXPECT_EQ(correctedEven(model, 3.0), correctedEven(lit, 3.0));
}

TEST(RangeModel, WithoutRangesThePlainOneStandsIn) {
  LightingModel model = makeModel(), plain = makeModel(LightingChoice::kPlain);
  learn(model, dropOff());
  learn(plain, dropOff());
  DiveScene scene(9);
  const auto picture = scene.textured(2.0);
  std::vector<std::uint8_t> with(picture.size()), without(picture.size()), unknown(picture.size());
  plain.correct(DiveScene::view(picture), with.data());
  model.correct(DiveScene::view(picture), without.data());
  RangeLattice nowhere;
  nowhere.path.fill(std::numeric_limits<float>::quiet_NaN());
  model.correct(DiveScene::view(picture), nowhere, unknown.data());
  EXPECT_EQ(with, without);
  EXPECT_EQ(with, unknown);
}

TEST(RangeModel, ImagesWithoutRangesTeachThePlainModelAlone) {
  LightingModel model = makeModel(LightingChoice::kRangeDependent);
  DiveScene scene(3);
  for (int k = 0; k < 20; ++k) model.add(DiveScene::view(scene.textured(2.0)));
  EXPECT_EQ(model.used(), LightingKind::kPlain);
  EXPECT_LT(model.report().error_range, 0);
}

TEST(LightingModelMemory, AddAndCorrectAllocateNothing) {
  DiveScene scene(3);
  std::vector<std::vector<std::uint16_t>> pictures;
  for (int k = 0; k < 30; ++k) pictures.push_back(scene.textured(2.0 + 0.1 * k));
  LightingModel model = makeModel();
  std::vector<std::uint8_t> out(kWidth * kHeight);
  const std::size_t bytes = model.report().memory_bytes;
  const auto before = fathom::test::threadCost();
  for (std::size_t k = 0; k < pictures.size(); ++k) {
    const RangeLattice range = DiveScene::ranges(2.0 + 0.1 * static_cast<double>(k));
    model.add(DiveScene::view(pictures[k]), range);
    model.correct(DiveScene::view(pictures[k]), range, out.data());
    model.correct(DiveScene::view(pictures[k]), out.data());
  }
  EXPECT_EQ((fathom::test::threadCost() - before).heap_calls, 0U);
  EXPECT_EQ(model.report().memory_bytes, bytes);
}

TEST(LightingModelColour, IsTheMissionsAndNotAnImages) {
  LightingModel model = makeModel();
  learn(model, dropOff());
  DiveScene scene(9);
  auto picture = scene.textured(3.0);
  std::vector<std::uint8_t> as_it_is(picture.size()), beside_white(picture.size());
  model.correct(DiveScene::view(picture), DiveScene::ranges(3.0), as_it_is.data());
  const auto half = static_cast<std::ptrdiff_t>(picture.size() / 2);
  std::fill(picture.begin() + half, picture.end(), std::uint16_t{4095});
  model.correct(DiveScene::view(picture), DiveScene::ranges(3.0), beside_white.data());
  EXPECT_TRUE(std::equal(as_it_is.begin(), as_it_is.begin() + half, beside_white.begin()));
}

}  // namespace
}  // namespace fathom::lighting
