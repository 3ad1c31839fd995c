#include "firmware_if/mission/feature_file.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <random>

#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::refusal;
using ::testing::HasSubstr;

StereoFeatureFrame sampleFrame() {
  StereoFeatureFrame frame{1360, 1024, {}};
  std::mt19937 random(3);
  std::uniform_real_distribution<float> x(0, 1359), y(0, 1023), size(8, 60);
  for (std::uint64_t i = 0; i < 300; ++i) {
    StereoFeature f;
    f.left = {x(random), y(random)};
    f.right = {x(random), y(random)};
    f.size = size(random);
    f.place_sigma = 0.6F;
    f.match_sigma = 0.05F;
    f.colour = {static_cast<std::uint8_t>(i), 20, 255};
    for (std::uint8_t& bin : f.descriptor) bin = static_cast<std::uint8_t>(random());
    frame.features.push_back(f);
  }
  return frame;
}

std::string refusalOf(std::vector<std::uint8_t> bytes) {
  StereoFeatureFrame frame;
  std::string line;
  try {
    parseFeatureFile(bytes, "pair.feat", frame);
  } catch (const InputError& e) {
    line = e.what();
  }
  if (!line.empty()) {
    EXPECT_TRUE(frame.features.empty());
  }
  return line;
}

// Corrects the CRC of changed bytes, so that the checks behind it are tested.
std::vector<std::uint8_t> sealed(std::vector<std::uint8_t> bytes) {
  std::uint32_t crc = 0xFFFFFFFFU;
  for (std::size_t i = 0; i + 4 < bytes.size(); ++i) {
    crc ^= bytes[i];
    for (int k = 0; k < 8; ++k) crc = crc >> 1 ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
  }
  for (std::size_t k = 0; k < 4; ++k)
    bytes[bytes.size() - 4 + k] = static_cast<std::uint8_t>(~crc >> (8 * k));
  return bytes;
}

constexpr std::size_t kHeader = 12, kRecord = 146;

TEST(FeatureFile, IsNamedAfterTheLeftImage) {
  EXPECT_EQ(featureFileName("PR_20231114_221320_123_LC16.tif"), "PR_20231114_221320_123_LC16.feat");
}

TEST(FeatureFile, HoldsEveryFeatureAndItsDescriptorToTheStatedSteps) {
  const StereoFeatureFrame frame = sampleFrame();
  const auto bytes = encodeFeatureFile(frame);
  EXPECT_EQ(bytes.size(), kHeader + 300 * kRecord + 4);
  const auto path = std::filesystem::path(::testing::TempDir()) / "pair.feat";
  writeFeatureFile(path, frame);
  const StereoFeatureFrame back = readFeatureFile(path);
  EXPECT_EQ(back.width, frame.width);
  EXPECT_EQ(back.height, frame.height);
  ASSERT_EQ(back.features.size(), frame.features.size());
  for (std::size_t i = 0; i < back.features.size(); ++i) {
    const StereoFeature &a = frame.features[i], &b = back.features[i];
    EXPECT_LE((a.left - b.left).cwiseAbs().maxCoeff(), 1.01F / 1024);
    EXPECT_LE((a.right - b.right).cwiseAbs().maxCoeff(), 1.01F / 1024);
    EXPECT_LE(std::abs(a.size - b.size), 0.25F);
    EXPECT_LE(std::abs(a.place_sigma - b.place_sigma), 1.0F / 256);
    EXPECT_LE(std::abs(a.match_sigma - b.match_sigma), 1.0F / 1024);
    EXPECT_EQ(a.colour, b.colour);
    EXPECT_EQ(a.descriptor, b.descriptor);
  }
  // What was read is written to the byte.
  EXPECT_EQ(encodeFeatureFile(back), bytes);
}

TEST(FeatureFile, AnEmptyFrameIsAFrame) {
  const auto bytes = encodeFeatureFile({640, 512, {}});
  StereoFeatureFrame frame;
  parseFeatureFile(bytes, "pair.feat", frame);
  EXPECT_EQ(frame.width, 640);
  EXPECT_TRUE(frame.features.empty());
}

TEST(FeatureFile, CutAtAnyByteIsRefused) {
  const auto bytes = encodeFeatureFile(sampleFrame());
  for (std::size_t n = 0; n < bytes.size(); n += n < 64 ? 1 : 97)
    EXPECT_THAT(refusalOf({bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n)}),
                HasSubstr("pair.feat"))
        << n;
}

TEST(FeatureFile, AnyChangedByteIsRefused) {
  const auto bytes = encodeFeatureFile(sampleFrame());
  for (std::size_t n = 0; n < bytes.size(); n += n < 64 ? 1 : 101) {
    auto damaged = bytes;
    damaged[n] ^= 0x10U;
    EXPECT_FALSE(refusalOf(damaged).empty()) << n;
  }
}

TEST(FeatureFile, NumbersThatCannotBeAreRefusedEvenUnderARightCrc) {
  const auto bytes = encodeFeatureFile(sampleFrame());
  ASSERT_EQ(sealed(bytes), bytes);
  const auto with = [&](std::size_t at, std::uint8_t value) {
    auto changed = bytes;
    changed[at] = value;
    return refusalOf(sealed(changed));
  };
  const std::size_t third = kHeader + 2 * kRecord;
  EXPECT_THAT(with(third + 2, 0x7F), HasSubstr("feature 3"));    // left pixel
  EXPECT_THAT(with(third + 8, 0x90), HasSubstr("right pixel"));  // far to the left
  EXPECT_THAT(with(third + 12, 0), HasSubstr("size"));
  EXPECT_THAT(with(third + 13, 0), HasSubstr("standard deviation"));
  EXPECT_THAT(with(third + 14, 0), HasSubstr("standard deviation"));
  EXPECT_THAT(with(4, 1), HasSubstr("version 1"));
  EXPECT_THAT(with(9, 0xFF), HasSubstr("size"));  // of the image
}

TEST(FeatureFile, AbsentAndForeignFilesAreRefusedInOneLine) {
  const auto folder = std::filesystem::path(::testing::TempDir());
  EXPECT_THAT(refusal([&] { static_cast<void>(readFeatureFile(folder / "no.feat")); }), HasSubstr("absent"));
  EXPECT_THAT(
      refusalOf({'I', 'I', '*', 0, 8, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16}),
      HasSubstr("no feature file"));
  EXPECT_THAT(refusalOf({}), HasSubstr("no feature file"));
}

TEST(FeatureFile, AFrameThatCouldNotBeReadBackIsNotWritten) {
  StereoFeatureFrame frame = sampleFrame();
  frame.features[5].left.x() = std::nanf("");
  EXPECT_THROW(static_cast<void>(encodeFeatureFile(frame)), std::invalid_argument);
  frame = sampleFrame();
  frame.features[5].match_sigma = 0;
  EXPECT_THROW(static_cast<void>(encodeFeatureFile(frame)), std::invalid_argument);
  frame = sampleFrame();
  frame.width = 0;
  EXPECT_THROW(static_cast<void>(encodeFeatureFile(frame)), std::invalid_argument);
}

TEST(FeatureMission, HasFeaturesAndNoImages) {
  const auto folder = std::filesystem::path(::testing::TempDir()) / "feature-mission";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder / "features");
  EXPECT_TRUE(isFeatureMission(MissionPaths(folder)));
  std::filesystem::create_directories(folder / "img");
  EXPECT_FALSE(isFeatureMission(MissionPaths(folder)));
}

}  // namespace
}  // namespace fathom::io
