#include <gtest/gtest.h>

#include "tests/lighting/strobed_dive.hpp"
#include "tests/support/strip_mask.hpp"

namespace fathom::lighting {
namespace {

using namespace test::strobed;

// Bright things that stand in every image, once seen and once hidden.
TEST(LightingModel, LearnsNothingFromWhatAMaskHides) {
  const ImageMask mask = fathom::test::stripMask(kWidth, kHeight, 60, 79);
  for (const PixelFormat format : {PixelFormat::kMono, PixelFormat::kBayerRggb, PixelFormat::kRgb}) {
    const std::size_t channels = format == PixelFormat::kRgb ? 3 : 1;
    double means[2];
    for (const bool hidden : {false, true}) {
      Dive dive(format, 8);
      LightingModel model(kWidth, kHeight, format, 8, kConfig);
      const auto next = [&] {
        Picture picture = dive.next();
        for (std::size_t y = 0; y < kHeight; ++y)
          std::fill_n(picture.bytes.begin() + static_cast<std::ptrdiff_t>((y * kWidth + 60) * channels),
                      20 * channels, 245);
        return picture;
      };
      for (int i = 0; i < 40; ++i) {
        const Picture picture = next();
        ImageView view = picture.view();
        if (hidden) view.mask = &mask;
        model.add(view);
      }
      std::vector<std::vector<std::uint8_t>> corrected(1);
      corrected[0].resize(kWidth * kHeight * channels);
      model.correct(next().view(), corrected[0].data());
      means[hidden ? 1 : 0] = statistics(corrected, {64, 40, 76, 80}, kAll, static_cast<int>(channels))[0];
    }
    EXPECT_LT(means[0], 0.85) << static_cast<int>(format);  // learnt to be what seafloor looks like there
    EXPECT_GT(means[1], 0.9) << static_cast<int>(format);
  }
}

}  // namespace
}  // namespace fathom::lighting
