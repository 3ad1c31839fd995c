#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <random>

#include "realtime/base/input_error.hpp"
#include "recon/products/tiles/bc1/block_rows.hpp"
#include "recon/products/tiles/block_texture.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/picture_codec.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/tiles.hpp"

namespace fathom::topside {
namespace {

RgbImage atlas() {
  test::SyntheticModel model{.texels = 96};
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

RgbImage seafloor(int width, int height) {
  RgbImage image{width, height, {}};
  image.rgb.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const Rgb rgb = test::SyntheticModel::colour(0.004 * y, 0.004 * x);
      std::copy(rgb.begin(), rgb.end(), image.at(x, y));
    }
  return image;
}

RgbImage flat(Rgb colour) {
  RgbImage image{8, 8, {}};
  for (int k = 0; k < 64; ++k) image.rgb.insert(image.rgb.end(), colour.begin(), colour.end());
  return image;
}

TEST(BlockTexture, KeepsAPictureAndEveryMipLevelCloseToIt) {
  const RgbImage image = seafloor(256, 128);
  const BlockTexture texture = compressBlocks(image);
  ASSERT_EQ(texture.levels.size(), 9U);
  EXPECT_EQ(texture.levels[0].size(), 256U * 128 / 2);
  EXPECT_GT(psnr(decompressBlocks(texture, 0), image), 38);
  const RgbImage quarter = decompressBlocks(texture, 2);
  EXPECT_EQ(quarter.width, 64);
  EXPECT_EQ(quarter.height, 32);
  // A texel of the second level stands for 4 x 4 of the picture.
  double off = 0;
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x) {
      double mean = 0;
      for (int k = 0; k < 16; ++k) mean += image.at(4 * x + k % 4, 4 * y + k / 4)[1] / 16.0;
      off = std::max(off, std::abs(mean - quarter.at(x, y)[1]));
    }
  EXPECT_LT(off, 10);
}

TEST(BlockTexture, AnyEdgeLengthsWork) {
  for (const auto& [width, height] : {std::pair(1, 1), std::pair(4, 1), std::pair(7, 13), std::pair(1, 64)}) {
    const RgbImage image = seafloor(width, height);
    const BlockTexture texture = compressBlocks(image);
    const RgbImage back = decompressBlocks(texture, 0);
    EXPECT_EQ(back.width, width);
    EXPECT_EQ(back.height, height);
    EXPECT_GT(psnr(back, image), 33);
    const RgbImage last = decompressBlocks(texture, texture.levels.size() - 1);
    EXPECT_EQ(last.width * last.height, 1);
  }
  EXPECT_THROW(static_cast<void>(compressBlocks({})), std::invalid_argument);
}

TEST(BlockTexture, OneColourComesOutWithinTwo) {
  for (const Rgb colour : {Rgb{0, 0, 0}, Rgb{255, 255, 255}, Rgb{13, 200, 77}, Rgb{128, 127, 4}}) {
    const RgbImage back = decompressBlocks(compressBlocks(flat(colour)), 0);
    for (int x = 0; x < 8; ++x)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(back.at(x, 3)[c], colour[static_cast<std::size_t>(c)], 2);
  }
}

TEST(BlockTexture, EveryInstructionSetGivesTheSameBits) {
  std::mt19937 random(7);
  constexpr int kBlocks = 2000;
  std::array<std::vector<std::uint8_t>, 4> rows;
  std::array<const std::uint8_t*, 4> begins{};
  for (std::size_t row = 0; row < 4; ++row) {
    for (int k = 0; k < 12 * kBlocks; ++k)  // from flat blocks to noise
      rows[row].push_back(static_cast<std::uint8_t>(100 + random() % (1 + static_cast<unsigned>(k) / 180)));
    begins[row] = rows[row].data();
  }
  std::vector<std::uint8_t> baseline(8 * kBlocks), fastest(8 * kBlocks);
  baselineBlockRow()(begins.data(), kBlocks, baseline.data());
  fastestBlockRow()(begins.data(), kBlocks, fastest.data());
  EXPECT_EQ(baseline, fastest);
}

TEST(BlockTexture, BothFilesComeBackAsTheyWere) {
  const BlockTexture texture = compressBlocks(seafloor(100, 36));
  EXPECT_EQ(readDds(writeDds(texture), "t.dds"), texture);
  const std::vector<std::uint8_t> plain = writeKtx2(texture),
                                  packed = writeKtx2(texture, Supercompression::kZstd);
  EXPECT_EQ(readKtx2(plain, "t.ktx2"), texture);
  EXPECT_EQ(readKtx2(packed, "t.ktx2"), texture);
  EXPECT_LT(packed.size(), plain.size());
}

// Words by their place in the KTX 2.0 specification, section 3.
TEST(BlockTexture, KtxHeaderSaysWhatTheSpecificationAsks) {
  const BlockTexture texture = compressBlocks(seafloor(100, 36));
  const std::vector<std::uint8_t> bytes = writeKtx2(texture);
  const auto word = [&](std::size_t at) {
    std::uint32_t value;
    std::memcpy(&value, bytes.data() + at, 4);
    return value;
  };
  EXPECT_EQ(word(12), 132U);  // VK_FORMAT_BC1_RGB_SRGB_BLOCK
  EXPECT_EQ(word(16), 1U);
  EXPECT_EQ(word(20), 100U);
  EXPECT_EQ(word(24), 36U);
  EXPECT_EQ(word(36), 1U);  // faces
  EXPECT_EQ(word(40), 7U);  // levels
  EXPECT_EQ(word(44), 0U);
  const std::uint32_t descriptor = word(48);
  EXPECT_EQ(descriptor, 80U + 7 * 24);
  EXPECT_EQ(word(52), word(descriptor));
  EXPECT_EQ(bytes[descriptor + 12], 128);  // BC1A
  EXPECT_EQ(bytes[descriptor + 13], 1);    // BT.709
  EXPECT_EQ(bytes[descriptor + 14], 2);    // sRGB
  EXPECT_EQ(word(56), descriptor + 44);
  EXPECT_EQ(word(56) % 4, 0U);
  std::uint64_t last = bytes.size();
  for (std::size_t level = 0; level < 7; ++level) {  // smallest level first in the file, each aligned
    std::uint64_t at, size;
    std::memcpy(&at, bytes.data() + 80 + 24 * level, 8);
    std::memcpy(&size, bytes.data() + 88 + 24 * level, 8);
    EXPECT_EQ(at % 8, 0U);
    EXPECT_LE(at + size, last);
    last = at;
  }
}

TEST(BlockTexture, DamagedFilesAreInputErrors) {
  const BlockTexture texture = compressBlocks(seafloor(32, 32));
  const std::vector<std::uint8_t> dds = writeDds(texture), ktx = writeKtx2(texture, Supercompression::kZstd);
  for (std::size_t length = 0; length + 1 < ktx.size(); length += 7) {
    EXPECT_THROW(static_cast<void>(readKtx2(std::span(ktx).first(length), "k")), InputError);
    if (length < dds.size()) {
      EXPECT_THROW(static_cast<void>(readDds(std::span(dds).first(length), "d")), InputError);
    }
  }
  for (std::size_t at = 0; at < ktx.size(); ++at) {
    std::vector<std::uint8_t> bad = ktx;
    bad[at] = static_cast<std::uint8_t>(~bad[at]);
    try {
      const BlockTexture read = readKtx2(bad, "k");
      EXPECT_EQ(read.levels.size(), texture.levels.size());
    } catch (const InputError&) {
    }
  }
}

// With the libraries that the pages are built with.
TEST(PageLibraries, KhronosValidatorThreesDracoAndItsKtxReaderTakeEveryKindOfTile) {
  const std::filesystem::path pages = FATHOM_PAGES;
  for (const char* module : {"three", "gltf-validator"})
    if (!std::filesystem::exists(pages / "node_modules" / module))
      GTEST_SKIP() << module << " is not installed";
  const fathom::test::TemporaryFolder scratch;
  test::SyntheticModel model;
  std::string files;
  const auto add = [&](const std::string& name, const std::vector<std::uint8_t>& bytes) {
    fathom::test::writeBytes(scratch.path() / name, bytes);
    files += " " + (scratch.path() / name).string();
  };
  GlbConfig config;
  config.gpu_texture = "a.ktx2";
  add("jpeg.glb", writeGlb(model.tile({0, -3, 1000}), model.grid, config));
  config.picture.format = PictureFormat::kWebp;
  add("webp.glb", writeGlb(model.tile({3, 0, -1}), model.grid, config));
  config.picture.format = PictureFormat::kNone;
  add("beside.glb", writeGlb(model.tile({1, 0, 0}), model.grid, config));
  const BlockTexture texture = compressBlocks(model.tile({0, 0, 0}).atlas);
  add("plain.ktx2", writeKtx2(texture));
  add("packed.ktx2", writeKtx2(texture, Supercompression::kZstd));
  model.texels = 0;
  add("colours.glb", writeGlb(model.tile({1, 0, 0}), model.grid, {}));
  const std::string command =
      "cd '" + pages.string() + "' && node " FATHOM_SOURCE_DIR "/tests/tiles/page_libraries.mjs" + files;
  EXPECT_EQ(std::system(command.c_str()), 0);
}

}  // namespace
}  // namespace fathom::topside
