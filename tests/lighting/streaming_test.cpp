// Learning during the dive: old light is forgotten, images of a hovering vehicle are not learnt, exposures
// come from the images' stamps.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/new_ground.hpp"

namespace fathom::lighting {
namespace {

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
