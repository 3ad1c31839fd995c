#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "recon/lighting/demosaic.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "tests/world/light_dives.hpp"

namespace fathom::lighting {
namespace {

using namespace test;

std::vector<std::uint8_t> mosaicOf(int width, int height, const std::array<std::uint8_t, 3>& rgb) {
  std::vector<std::uint8_t> mosaic;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) mosaic.push_back(rgb[static_cast<std::size_t>(colourAt(x, y))]);
  return mosaic;
}

TEST(Demosaic, RedStaysRedAndBlueStaysBlueUpToTheEdges) {
  const auto mosaic = mosaicOf(8, 6, {200, 90, 30});
  std::vector<std::uint8_t> rgb(8 * 6 * 3), mono(8 * 6);
  const ImageView view{mosaic.data(), 8, 6, 8, PixelFormat::kBayerRggb, 8};
  greyOf(view, {26, 115, 115}, rgb.data(), mono.data());
  for (std::size_t i = 0; i < rgb.size(); i += 3) {
    EXPECT_EQ(rgb[i], 200) << i;
    EXPECT_EQ(rgb[i + 1], 90) << i;
    EXPECT_EQ(rgb[i + 2], 30) << i;
  }
  for (const std::uint8_t v : mono) EXPECT_NEAR(v, (26 * 200 + 115 * 90 + 115 * 30) / 256.0, 0.5);
}

TEST(Demosaic, ASpotStaysWhereItIs) {
  std::vector<std::uint8_t> mosaic = mosaicOf(16, 16, {50, 50, 50});
  mosaic[6 * 16 + 8] = 250;  // a red sample
  std::vector<std::uint8_t> rgb(16 * 16 * 3);
  demosaicRgb({mosaic.data(), 16, 16, 16, PixelFormat::kBayerRggb, 8}, rgb.data());
  EXPECT_EQ(rgb[(6 * 16 + 8) * 3], 250);
  EXPECT_EQ(rgb[(6 * 16 + 8) * 3 + 1], 50);
  EXPECT_EQ(rgb[(6 * 16 + 9) * 3], 150);
  EXPECT_EQ(rgb[(6 * 16 + 7) * 3], 150);
  EXPECT_EQ(rgb[(5 * 16 + 7) * 3], 100);
}

TEST(Demosaic, MonoIsCopiedAndOtherDepthsLeaveTheOutputAlone) {
  const std::vector<std::uint8_t> gray = {1, 2, 3, 4, 5, 6};
  std::vector<std::uint8_t> mono(6), rgb(18);
  const ImageView view{gray.data(), 3, 2, 3, PixelFormat::kMono, 8};
  greyOf(view, usualShares(PixelFormat::kMono), nullptr, mono.data());
  demosaicRgb(view, rgb.data());
  EXPECT_EQ(mono, gray);
  EXPECT_EQ(rgb, (std::vector<std::uint8_t>{1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 5, 5, 5, 6, 6, 6}));
  std::vector<std::uint8_t> untouched(6, 9);
  ImageView deep = view;
  deep.bits = 12;
  greyOf(deep, usualShares(PixelFormat::kMono), nullptr, untouched.data());
  greyOf({}, usualShares(PixelFormat::kMono), nullptr, untouched.data());
  EXPECT_EQ(untouched, std::vector<std::uint8_t>(6, 9));
}

TEST(Demosaic, TheSmallestMosaicsGiveAnImage) {
  for (int side = 2; side <= 4; ++side) {
    const auto mosaic = mosaicOf(side, side, {200, 90, 30});
    std::vector<std::uint8_t> rgb(static_cast<std::size_t>(side * side * 3), 1);
    demosaicRgb({mosaic.data(), side, side, static_cast<std::size_t>(side), PixelFormat::kBayerRggb, 8},
                rgb.data());
    if (side > 2) {
      EXPECT_EQ(rgb[0], 200) << side;
    }
  }
}

// One floor whose colours are patterned each for itself, by a camera with filters and one without. Water
// leaves a tenth of the red.
TEST(Grey, OfAMosaicIsWhatACameraWithoutFiltersSees) {
  constexpr int kWidth = 96, kHeight = 72, kCoarse = 8, kImages = 12, kBits = 12;
  constexpr std::array<double, 3> kLight = {0.05, 0.5, 0.4};
  constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
  std::mt19937 random(3);
  std::normal_distribution<double> pattern(0, 0.25), noise(0, 0.004);
  LightingModel filtered(kWidth, kHeight, PixelFormat::kBayerRggb, kBits, {}),
      unfiltered(kWidth, kHeight, PixelFormat::kMono, kBits, {});
  std::vector<std::uint16_t> mosaic(kPixels), mono(kPixels);
  const auto viewOf = [&](const std::vector<std::uint16_t>& samples, PixelFormat format) {
    return ImageView{samples.data(), kWidth, kHeight, 2 * std::size_t{kWidth}, format, kBits};
  };
  const auto sampleOf = [&](double light) {
    return static_cast<std::uint16_t>(std::lround(std::clamp(light + noise(random), 0.0, 1.0) * 4095));
  };
  for (int image = 0; image < kImages; ++image) {
    std::array<std::array<double, std::size_t{kWidth / kCoarse + 2} * (kHeight / kCoarse + 2)>, 3> floor{};
    for (auto& colour : floor)
      for (double& r : colour) r = std::max(1 + pattern(random), 0.0);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        // Bilinear between coarse values, so that demosaicing finds it again.
        const auto at = [&](std::size_t c) {
          const double u = static_cast<double>(x) / kCoarse, v = static_cast<double>(y) / kCoarse;
          const auto i = static_cast<std::size_t>(u), j = static_cast<std::size_t>(v);
          const double du = u - static_cast<double>(i), dv = v - static_cast<double>(j);
          const auto r = [&](std::size_t di, std::size_t dj) {
            return floor[c][(j + dj) * (kWidth / kCoarse + 2) + i + di];
          };
          return kLight[c] *
                 ((1 - dv) * ((1 - du) * r(0, 0) + du * r(1, 0)) + dv * ((1 - du) * r(0, 1) + du * r(1, 1)));
        };
        const auto k = static_cast<std::size_t>(y * kWidth + x);
        mosaic[k] = sampleOf(at(static_cast<std::size_t>(colourAt(x, y))));
        mono[k] = sampleOf((at(0) + at(1) + at(2)) / 3);
      }
    filtered.add(viewOf(mosaic, PixelFormat::kBayerRggb));
    unfiltered.add(viewOf(mono, PixelFormat::kMono));
  }
  std::vector<std::uint8_t> levels(kPixels), rgb(3 * kPixels), grey(kPixels), seen(kPixels);
  filtered.grey(viewOf(mosaic, PixelFormat::kBayerRggb), {}, levels.data(), rgb.data(), grey.data());
  unfiltered.grey(viewOf(mono, PixelFormat::kMono), {}, nullptr, nullptr, seen.data());
  double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
  for (std::size_t k = 0; k < kPixels; ++k) {
    const double x = grey[k], y = seen[k];
    ++n, a += x, b += y, aa += x * x, bb += y * y, ab += x * y;
  }
  const double correlation = (ab - a * b / n) / std::sqrt((aa - a * a / n) * (bb - b * b / n));
  EXPECT_GT(correlation, 0.98) << "luminance of the corrected colours has 0.77";
}

}  // namespace
}  // namespace fathom::lighting
