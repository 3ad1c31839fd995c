#include "recon/products/tiles/picture_codec.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "realtime/base/input_error.hpp"
#include "tests/tiles/synthetic_model.hpp"

namespace fathom::topside {
namespace {

RgbImage atlas() {
  synthetic::SyntheticModel model;
  model.texels = 96;
  return model.tile({0, 0, 0}).atlas;
}

TEST(PictureCodec, BetterQualityIsCloserAndLarger) {
  const RgbImage image = atlas();
  for (const PictureFormat format : {PictureFormat::kJpeg, PictureFormat::kWebp}) {
    double last_psnr = 0;
    std::size_t last_size = 0;
    for (const int quality : {30, 60, 95}) {
      const auto bytes = encodePicture(image, {.format = format, .quality = quality});
      const double decibels = psnr(decodePicture(bytes, "atlas"), image);
      EXPECT_GT(decibels, last_psnr);
      EXPECT_GT(bytes.size(), last_size);
      last_psnr = decibels;
      last_size = bytes.size();
    }
  }
}

TEST(PictureCodec, DamagedPicturesAreInputErrorsAndLeaveTheNextOneAlone) {
  const RgbImage image = atlas();
  for (const PictureFormat format : {PictureFormat::kJpeg, PictureFormat::kWebp}) {
    const auto good = encodePicture(image, {.format = format});
    const RgbImage whole = decodePicture(good, "atlas");
    int refused = 0;
    for (std::size_t at = 0; at < good.size(); at += 23) {
      auto bad = good;
      bad[at] = static_cast<std::uint8_t>(~bad[at]);
      try {
        EXPECT_EQ(decodePicture(bad, "atlas", 4096).rgb.size() % 3, 0U);
      } catch (const InputError&) {
        ++refused;
      }
      EXPECT_EQ(decodePicture(good, "atlas").rgb, whole.rgb) << at;
    }
    EXPECT_GT(refused, 3);
    EXPECT_THROW(static_cast<void>(decodePicture(std::span(good).first(good.size() / 2), "cut")), InputError);
  }
  EXPECT_THROW(static_cast<void>(decodePicture({}, "empty")), InputError);
}

TEST(PictureCodec, PsnrIsTheNoisesLevel) {
  RgbImage image = atlas();
  RgbImage other = image;
  EXPECT_TRUE(std::isinf(psnr(image, other)));
  for (std::uint8_t& value : other.rgb)
    value = static_cast<std::uint8_t>(value < 128 ? value + 1 : value - 1);
  EXPECT_NEAR(psnr(image, other), 48.13, 0.01);  // 20 log10(255) for an error of 1
}

TEST(PictureCodec, RefusesImagesWithoutPixelsAndQualitiesOffTheScale) {
  EXPECT_THROW(static_cast<void>(encodePicture({}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(encodePicture(atlas(), {.quality = 0})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(encodePicture(atlas(), {.format = PictureFormat::kNone})),
               std::invalid_argument);
}

}  // namespace
}  // namespace fathom::topside
