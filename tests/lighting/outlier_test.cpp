#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "recon/lighting/lighting_model.hpp"
#include "tests/lighting/synthetic_range_dive.hpp"

namespace fathom::lighting {
namespace {

using namespace test;

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
