// A loaded lighting model corrects and learns as the saved one.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "recon/lighting/lighting_model.hpp"
#include "tests/support/saved_state.hpp"

namespace fathom::lighting {
namespace {

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

}  // namespace
}  // namespace fathom::lighting
