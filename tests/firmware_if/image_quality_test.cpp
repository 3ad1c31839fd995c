// Sharpness and light of one image, as the check before the launch measures them.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/firmware_if/synthetic_picture.hpp"

namespace fathom::io {
namespace {

using test::kHeight, test::kWidth;

TEST(ImageQuality, EdgesWidenWithBlurWhateverTheContrast) {
  for (const double light : {0.6, 1.0}) {
    double before = 0;
    for (const double blur : {0.0, 1.0, 2.0, 3.0}) {
      if (light < 1 && blur > 2) continue;  // drowned in noise
      const ImageQuality quality = measureImage(test::viewOf(test::syntheticPicture(blur, light)));
      ASSERT_GE(quality.edges, ImageQuality::kFewestEdges) << blur;
      EXPECT_GT(quality.edge_width_px, before);
      EXPECT_NEAR(quality.edge_width_px, std::max(2.0, std::sqrt(2 * std::numbers::pi) * blur), 1.5)
          << blur << " px at " << light;
      before = quality.edge_width_px;
    }
  }
}

TEST(ImageQuality, NoiseAloneHasNoEdges) {
  std::mt19937 random(2);
  std::normal_distribution<double> noise(60, 4);
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(kWidth) * kHeight);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(noise(random));
  EXPECT_EQ(measureImage(test::viewOf(bytes)).edge_width_px, 0);
  EXPECT_EQ(measureImage({}).edges, 0);
}

TEST(ImageQuality, LightIsInSharesOfFullScale) {
  std::vector<std::uint16_t> words(static_cast<std::size_t>(kWidth) * kHeight, 2048);
  std::fill(words.begin(), words.begin() + static_cast<std::ptrdiff_t>(words.size() / 4), 4095);
  std::fill(words.end() - static_cast<std::ptrdiff_t>(words.size() / 4), words.end(), 10);
  const ImageView image = {words.data(), kWidth, kHeight, kWidth * 2, PixelFormat::kBayerRggb, 12};
  const ImageQuality quality = measureImage(image);
  EXPECT_NEAR(quality.mean, 0.5, 0.01);
  EXPECT_NEAR(quality.saturated_share, 0.25, 1e-9);
  EXPECT_NEAR(quality.dark_share, 0.25, 1e-9);
}

}  // namespace
}  // namespace fathom::io
