#include "recon/lighting/texture_gain.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "recon/lighting/lighting_model.hpp"

namespace fathom::lighting {
namespace {

constexpr int kWidth = 384, kHeight = 288, kPatch = 8;  // [px]
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;

// Patches of a floor, of mean 0 and standard deviation 1.
std::vector<double> patches(std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::vector<double> of_patch(kPixels / (kPatch * kPatch));
  for (double& r : of_patch) r = normal(random);
  std::vector<double> out;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      out.push_back(of_patch[static_cast<std::size_t>(y / kPatch * (kWidth / kPatch) + x / kPatch)]);
  return out;
}

TEST(TextureGain, LeavesWhatEightBitsShowAndStopsWhereNoiseBegins) {
  std::mt19937 random(3);
  const std::vector<double> floor = patches(random);
  const auto gainOf = [&](double spread) {
    std::vector<std::uint8_t> grey;
    for (const double r : floor)
      grey.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(110 + spread * r, 0.0, 255.0))));
    return textureGain(grey.data(), kWidth, kHeight);
  };
  EXPECT_EQ(gainOf(5), 1);
  EXPECT_NEAR(gainOf(2), 2, 0.4);
  EXPECT_NEAR(gainOf(0.8), 4 / 0.8, 0.6);
  EXPECT_EQ(gainOf(0), 16);
  const std::vector<std::uint8_t> small(31 * 31);
  EXPECT_EQ(textureGain(small.data(), 31, 31), 1);
}

class PictureForMatching : public testing::TestWithParam<PixelFormat> {};

// Silt before the floor: a fifth of a level of texture, on a veil that changes by forty across the image.
TEST_P(PictureForMatching, ShowsFaintTextureUnderAVeilAsItIs) {
  constexpr double kFull = 4095, kLight = 0.5;
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.0005);
  const auto photographed = [&](const std::vector<double>& floor, double share, double slope) {
    std::vector<std::uint16_t> samples;
    for (std::size_t k = 0; k < kPixels; ++k) {
      const double veil = slope * (static_cast<double>(k % kWidth) / kWidth - 0.5);
      const double light = kLight * std::max(1 + veil + share * floor[k], 0.0) + noise(random);
      samples.push_back(static_cast<std::uint16_t>(std::lround(kFull * std::min(light, 1.0))));
    }
    return samples;
  };
  const auto view = [](const std::vector<std::uint16_t>& samples) {
    return ImageView{samples.data(), kWidth, kHeight, std::size_t{2} * kWidth, GetParam(), 12};
  };
  LightingModel model(kWidth, kHeight, GetParam(), 12, {});
  std::vector<std::uint8_t> mosaic(kPixels), rgb(3 * kPixels), grey(kPixels);
  const std::vector<double> floor = patches(random);
  model.grey(view(photographed(floor, 0.002, 0.4)), {}, mosaic.data(), rgb.data(), grey.data());
  const auto [darkest, brightest] = std::minmax_element(grey.begin(), grey.end());
  EXPECT_NEAR(*brightest - *darkest, 0.4 * kLight * 255, 3) << "a model without images leaves it";
  for (int i = 0; i < 20; ++i) model.add(view(photographed(patches(random), 0.3, 0)));

  model.grey(view(photographed(floor, 0.002, 0.4)), {}, mosaic.data(), rgb.data(), grey.data());
  // Against the floor, column by column: the veil is the same all along each.
  double both = 0, seen = 0, there = 0;
  for (int x = 0; x < kWidth; ++x) {
    double mean = 0, of_floor = 0;
    const auto at = [&](int y) { return static_cast<std::size_t>(y * kWidth + x); };
    for (int y = 0; y < kHeight; ++y)
      mean += grey[at(y)] / double{kHeight}, of_floor += floor[at(y)] / kHeight;
    for (int y = 0; y < kHeight; ++y) {
      const double a = grey[at(y)] - mean, b = floor[at(y)] - of_floor;
      both += a * b, seen += a * a, there += b * b;
    }
  }
  EXPECT_GT(both / std::sqrt(seen * there), 0.7) << "rounded as it is it has 0.17";
  EXPECT_EQ(std::count(grey.begin(), grey.end(), 0) + std::count(grey.begin(), grey.end(), 255), 0);
}

INSTANTIATE_TEST_SUITE_P(Formats, PictureForMatching,
                         testing::Values(PixelFormat::kMono, PixelFormat::kBayerRggb));

}  // namespace
}  // namespace fathom::lighting
