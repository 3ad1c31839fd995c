#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "recon/geometry/colour.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "tests/support/saved_state.hpp"

namespace fathom::lighting {
namespace {

// A loaded lighting model corrects and learns as the saved one.

constexpr int kStateWidth = 96, kStateHeight = 80;  // [px]
constexpr LightingConfig kStateConfig{.grid = 8, .memory = 12};

struct Sight {
  std::vector<std::uint16_t> pixels;
  RangeLattice range;
  [[nodiscard]] ImageView view() const {
    return {pixels.data(), kStateWidth, kStateHeight, kStateWidth * 2, PixelFormat::kBayerRggb, 12};
  }
};

// The k-th image: a lamp on the left, a seafloor of patches, at a range that changes.
Sight sightOf(unsigned k) {
  Sight sight;
  std::mt19937 random(k);
  std::normal_distribution<double> patch(1.0, 0.2);
  const double range = 1.2 + 0.1 * (k % 9);
  sight.range.path.fill(k % 11 == 0 ? 0.0F : static_cast<float>(range));
  for (int y = 0; y < kStateHeight; ++y)
    for (int x = 0; x < kStateWidth; ++x) {
      const double light = 3000 / (1 + 0.02 * x) * std::exp(-range) * std::max(patch(random), 0.0);
      sight.pixels.push_back(static_cast<std::uint16_t>(std::clamp(light, 0.0, 4095.0)));
    }
  return sight;
}

void learnSights(LightingModel& model, unsigned from, unsigned to) {
  for (unsigned k = from; k < to; ++k) {
    const Sight sight = sightOf(k);
    model.add(sight.view(), sight.range, k % 5 == 0 ? 0.006 : 0.004);
  }
}

std::vector<std::uint8_t> correctedSight(const LightingModel& model) {
  const Sight sight = sightOf(999);
  std::vector<std::uint8_t> out(kStateWidth * kStateHeight);
  model.correct(sight.view(), sight.range, out.data(), 0.005);
  return out;
}

LightingModel freshModel() {
  return {kStateWidth, kStateHeight, PixelFormat::kBayerRggb, 12, kStateConfig};
}

bool loadModel(LightingModel& model, std::span<const std::uint8_t> bytes) {
  rt::StateReader reader(bytes);
  return model.load(reader);
}

TEST(LightingState, ALoadedModelContinuesBitByBit) {
  for (const unsigned images : {0U, 1U, 40U}) {
    LightingModel whole = freshModel(), loaded = freshModel();
    learnSights(whole, 0, images);
    learnSights(loaded, 200, 220);  // forgotten
    const std::vector<std::uint8_t> state = test::savedState(whole);
    ASSERT_TRUE(loadModel(loaded, state));
    EXPECT_EQ(loaded.images(), whole.images());
    EXPECT_EQ(correctedSight(loaded), correctedSight(whole));
    EXPECT_EQ(test::savedState(loaded), state);
    for (LightingModel* model : {&whole, &loaded}) learnSights(*model, images, images + 25);
    EXPECT_EQ(loaded.used(), whole.used());
    EXPECT_EQ(correctedSight(loaded), correctedSight(whole));
    EXPECT_EQ(test::savedState(loaded), test::savedState(whole));
  }
}

TEST(LightingState, AModelOfAnotherShapeRefuses) {
  LightingModel whole = freshModel();
  learnSights(whole, 0, 5);
  LightingModel other(kStateWidth * 2, kStateHeight, PixelFormat::kBayerRggb, 12, kStateConfig);
  EXPECT_FALSE(loadModel(other, test::savedState(whole)));
}

TEST(LightingState, DamageIsRefusedOrDoesNoHarm) {
  LightingModel whole = freshModel();
  learnSights(whole, 0, 20);
  const std::vector<std::uint8_t> state = test::savedState(whole);
  LightingModel other = freshModel();
  test::eachRefused(state, 40, [&](auto bytes) { return loadModel(other, bytes); });
  test::eachDamage(state, 30, [&](auto bytes) {
    (void)loadModel(other, bytes);
    learnSights(other, 30, 31);
    (void)correctedSight(other);
  });
  EXPECT_TRUE(loadModel(other, state));
}

// Learning during the dive: old light is forgotten, images of a hovering vehicle are not learnt, exposures
// come from the images' stamps.

constexpr int kStreamWidth = 96, kStreamHeight = 64;  // [px]

// A sandy floor of patches under a lamp to the left or to the right of the camera.
class LampFloor {
 public:
  std::vector<std::uint16_t> next(bool lamp_on_the_left, double exposure = 1) {
    std::normal_distribution<double> reflectance(1.0, 0.2);
    std::vector<double> patches(16 * 12);
    for (double& r : patches) r = std::max(reflectance(random_), 0.05);
    std::vector<std::uint16_t> pixels;
    for (int y = 0; y < kStreamHeight; ++y)
      for (int x = 0; x < kStreamWidth; ++x) {
        const double side = lamp_on_the_left ? x : kStreamWidth - 1 - x;
        const double light = exposure * 1600 / (1 + 2 * side / kStreamWidth) *
                             patches[static_cast<std::size_t>(y / 6 * 16 + x / 6)];
        pixels.push_back(static_cast<std::uint16_t>(std::clamp(light, 0.0, 4095.0)));
      }
    return pixels;
  }

 private:
  std::mt19937 random_{11};
};

ImageView view(const std::vector<std::uint16_t>& pixels) {
  return {pixels.data(), kStreamWidth, kStreamHeight, kStreamWidth * 2, PixelFormat::kMono, 12};
}

LightingModel modelOf(int memory) {
  return {kStreamWidth, kStreamHeight, PixelFormat::kMono, 12, {.grid = 8, .memory = memory}};
}

const RangeLattice kUnknown;

// Mean of the left and of the right third of 30 meanOfThirds images, in parts of full scale.
struct Thirds {
  double left = 0, right = 0;
};
Thirds meanOfThirds(const LightingModel& model, LampFloor& floor, bool lamp_on_the_left, double exposure = 1,
                    double exposure_s = 0) {
  Thirds sum;
  constexpr int kImages = 30, kThird = kStreamWidth / 3;
  std::vector<std::uint8_t> out(kStreamWidth * kStreamHeight);
  for (int k = 0; k < kImages; ++k) {
    model.correct(view(floor.next(lamp_on_the_left, exposure)), kUnknown, out.data(), exposure_s);
    for (int y = 0; y < kStreamHeight; ++y)
      for (int x = 0; x < kThird; ++x) {
        sum.left += out[static_cast<std::size_t>(y * kStreamWidth + x)];
        sum.right += out[static_cast<std::size_t>((y + 1) * kStreamWidth - 1 - x)];
      }
  }
  const double samples = 255.0 * kImages * kStreamHeight * kThird;
  return {sum.left / samples, sum.right / samples};
}

double slopeAfterTheLampChanged(int memory) {
  LampFloor floor;
  LightingModel model = modelOf(memory);
  for (int k = 0; k < 1200; ++k) model.add(view(floor.next(true)), kUnknown);
  for (int k = 0; k < 400; ++k) model.add(view(floor.next(false)), kUnknown);
  const Thirds thirds = meanOfThirds(model, floor, false);
  return std::abs(thirds.left - thirds.right);
}

TEST(StreamingLight, ForgetsTheLightOfLongAgo) {
  EXPECT_GT(slopeAfterTheLampChanged(0), 0.15);  // without forgetting a quarter of it is learnt
  EXPECT_LT(slopeAfterTheLampChanged(100), 0.06);
}

TEST(StreamingLight, WhatForgetsCorrectsAsWellAsWhatDoesNot) {
  LampFloor floor;
  LightingModel model = modelOf(100);
  for (int k = 0; k < 1000; ++k) model.add(view(floor.next(true)), kUnknown);
  const Thirds thirds = meanOfThirds(model, floor, true);
  EXPECT_NEAR(thirds.left, LightingConfig().target_mean, 0.015);
  EXPECT_NEAR(thirds.right, LightingConfig().target_mean, 0.015);
}

TEST(StreamingLight, AnotherExposureIsAppliedAtOnceAndNotLearnt) {
  LampFloor floor;
  LightingModel model = modelOf(0);
  for (int k = 0; k < 100; ++k) model.add(view(floor.next(true)), kUnknown, 0.004);
  const Thirds before = meanOfThirds(model, floor, true, 1, 0.004);
  const Thirds stamped = meanOfThirds(model, floor, true, 1.5, 0.006);
  const Thirds unstamped = meanOfThirds(model, floor, true, 1.5);
  EXPECT_NEAR(stamped.left, before.left, 0.01);
  EXPECT_NEAR(stamped.right, before.right, 0.01);
  EXPECT_GT(unstamped.left, before.left + 0.1);
  for (int k = 0; k < 300; ++k) model.add(view(floor.next(true, 1.5)), kUnknown, 0.006);
  const Thirds after = meanOfThirds(model, floor, true, 1, 0.004);
  EXPECT_NEAR(after.left, before.left, 0.01);
  EXPECT_NEAR(after.right, before.right, 0.01);
}

// A sensor that reads 0.02 in the dark, and exposures from a quarter to four times the usual: what is light
// follows the exposure, what the sensor adds does not.
TEST(StreamingLight, KeepsTheGroundsBrightnessAtExposuresFromAQuarterToFour) {
  constexpr double kBlack = 0.02, kFull = 4095;
  constexpr std::array<double, 5> kExposures = {0.25, 0.5, 1, 2, 4};
  LampFloor floor;
  const auto picture = [&](double exposure) {
    // Of an eighth of the light, so that four times as much clips little.
    std::vector<std::uint16_t> pixels = floor.next(true, exposure / 4);
    for (std::uint16_t& p : pixels) p = static_cast<std::uint16_t>(std::min(p + kBlack * kFull, kFull));
    return pixels;
  };
  LightingModel model = modelOf(0);
  for (std::size_t k = 0; k < 60; ++k) {
    const double exposure = kExposures[k % kExposures.size()];
    model.add(view(picture(exposure)), kUnknown, 0.004 * exposure);
  }
  EXPECT_NEAR(model.report().black, kBlack, 0.004);
  std::vector<std::uint8_t> out(kStreamWidth * kStreamHeight);
  std::array<double, kExposures.size()> light{};
  for (std::size_t e = 0; e < kExposures.size(); ++e)
    for (int k = 0; k < 40; ++k) {
      model.correctColour(view(picture(kExposures[e])), kUnknown, out.data(),
                          {.exposure_s = 0.004 * kExposures[e]});
      for (const std::uint8_t level : out)
        light[e] += linearFromSrgb(level / 255.0) / 40 / static_cast<double>(out.size());
    }
  for (const double of_exposure : light) EXPECT_NEAR(of_exposure / light[2], 1, 0.05);
}

TEST(NewGround, TakesAMovingVehiclesImagesAndNoneOfAHoveringOne) {
  NewGround ground;
  int moving = 0, hovering = 0;
  for (int k = 0; k < 200; ++k) moving += ground.take({0.25 * k, 0, 10}, 1.2) ? 1 : 0;
  EXPECT_EQ(moving, 200);
  // Station keeping to a few centimetres, for 1,000 images.
  std::mt19937 random(3);
  std::normal_distribution<double> wander(0, 0.05);
  for (int k = 0; k < 1000; ++k)
    hovering += ground.take({100 + wander(random), wander(random), 10 + wander(random)}, 1.2) ? 1 : 0;
  EXPECT_LE(hovering, 3);
  EXPECT_FALSE(ground.take({40.1, 0, 10}, 1.2));  // one of the last 64
  EXPECT_TRUE(ground.take({20.1, 0, 10}, 1.2));   // a line beside it, much later, is new ground
}

}  // namespace
}  // namespace fathom::lighting
