#include <gmock/gmock.h>

#include <cmath>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <random>

#include "firmware_if/mission/feature_file.hpp"
#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/civil_time.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::readText, test::refusal, test::writeText, ::testing::HasSubstr;

TEST(CivilTime, AgreesWithKnownMomentsBeforeAndAfterTheEpoch) {
  const CivilTime t = civilFromUtc(1709251199'999'999'999);  // the last moment of a leap day
  EXPECT_EQ(t.year, 2024);
  EXPECT_EQ(t.month, 2);
  EXPECT_EQ(t.day, 29);
  EXPECT_EQ(t.hour, 23);
  EXPECT_EQ(t.second, 59);
  EXPECT_EQ(t.nanosecond, 999'999'999);
  const CivilTime before = civilFromUtc(-1);
  EXPECT_EQ(before.year, 1969);
  EXPECT_EQ(before.nanosecond, 999'999'999);
  EXPECT_EQ(utcFromCivil(t), 1709251199'999'999'999);
  EXPECT_EQ(utcFromCivil(before), -1);
}

TEST(CivilTime, DatesThatDoNotExistAreRefused) {
  EXPECT_FALSE(utcFromCivil({2023, 2, 29}));
  EXPECT_FALSE(utcFromCivil({2023, 13, 1}));
  EXPECT_FALSE(utcFromCivil({2023, 1, 0}));
  EXPECT_FALSE(utcFromCivil({2023, 1, 1, 24}));
  EXPECT_FALSE(utcFromCivil({2023, 1, 1, 23, 59, 60}));
  EXPECT_FALSE(utcFromCivil({2300, 1, 1}));
}

TEST(ImageName, CarriesUtcTruncatedToTheMillisecondAndTheSide) {
  EXPECT_EQ(imageFileName(1700000000'123'999'999, CameraSide::kLeft), "PR_20231114_221320_123_LC16.tif");
  EXPECT_EQ(imageFileName(1700000000'123'999'999, CameraSide::kRight), "PR_20231114_221320_123_RM16.tif");
  const auto name = parseImageFileName("PR_20231114_221320_123_RM16.tif");
  ASSERT_TRUE(name);
  EXPECT_EQ(name->utc_ns, 1700000000'123'000'000);
  EXPECT_EQ(name->side, CameraSide::kRight);
}

TEST(ImageName, OtherNamesAreNone) {
  for (const char* name : {"", "PR_20231114_221320_123_XX16.tif", "PR_20230229_221320_123_LC16.tif",
                           "PR_2023111x_221320_123_LC16.tif", "PR_20231114_221320_123_LC16.tiff",
                           "../20231114_221320_123_LC16.tif", "PR_20231114_221320_-12_LC16.tif",
                           "PR_20231114_246020_123_LC16.tif"})
    EXPECT_FALSE(parseImageFileName(name)) << name;
}

TEST(ImageName, OnlyPlainNamesMayComeFromALog) {
  EXPECT_TRUE(plainFileName("a.tif"));
  for (const std::string name : {"", ".", "..", "../a.tif", "/a.tif", "a/b.tif"})
    EXPECT_FALSE(plainFileName(name));
  EXPECT_FALSE(plainFileName(std::string("a\0b", 3)));
}

class ImageFileTest : public ::testing::Test {
 protected:
  // A noisy picture, rows padded to a stride, as a camera's buffer is.
  template <class Sample>
  ImageView noise(std::vector<Sample>& storage, int width, int height, int channels, int bits,
                  PixelFormat format) {
    constexpr std::size_t kPadding = 3;
    const std::size_t row = static_cast<std::size_t>(width * channels) + kPadding;
    storage.resize(row * static_cast<std::size_t>(height));
    std::mt19937 random(3);
    for (Sample& sample : storage) sample = static_cast<Sample>(random() & ((1u << bits) - 1));
    return {storage.data(), width, height, row * sizeof(Sample), format, bits};
  }
  static bool samePixels(const ImageView& a, const ImageView& b, std::size_t row_bytes) {
    for (int y = 0; y < a.height; ++y)
      if (std::memcmp(static_cast<const char*>(a.data) + static_cast<std::size_t>(y) * a.stride,
                      static_cast<const char*>(b.data) + static_cast<std::size_t>(y) * b.stride,
                      row_bytes) != 0)
        return false;
    return true;
  }
  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_.path() / "image.tif";
};

TEST_F(ImageFileTest, TwelveBitBayerPixelsComeBackAsTheyWere) {
  std::vector<std::uint16_t> storage;
  const ImageView view = noise(storage, 137, 101, 1, 12, PixelFormat::kBayerRggb);
  writeImage(path_, view);
  const ImageFile read = readImage(path_, PixelFormat::kBayerRggb, 12, 137, 101);
  EXPECT_TRUE(samePixels(view, read.view, 137 * 2));
  EXPECT_EQ(read.view.format, PixelFormat::kBayerRggb);
  EXPECT_EQ(read.view.bits, 12);
}

TEST_F(ImageFileTest, EightBitMonoAndColourPixelsComeBackAsTheyWere) {
  std::vector<std::uint8_t> storage;
  const ImageView mono = noise(storage, 64, 70, 1, 8, PixelFormat::kMono);
  writeImage(path_, mono);
  EXPECT_TRUE(samePixels(mono, readImage(path_, PixelFormat::kMono, 8).view, 64));
  const ImageView colour = noise(storage, 33, 20, 3, 8, PixelFormat::kRgb);
  writeImage(path_, colour);
  EXPECT_TRUE(samePixels(colour, readImage(path_, PixelFormat::kRgb, 8).view, 33 * 3));
}

TEST_F(ImageFileTest, OtherProgramsReadWhatIsWrittenAndTheReverse) {
  std::vector<std::uint16_t> storage;
  const ImageView view = noise(storage, 50, 40, 1, 12, PixelFormat::kMono);
  writeImage(path_, view);
  const cv::Mat by_opencv = cv::imread(path_.string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(by_opencv.type(), CV_16UC1);
  const ImageView other{by_opencv.data, 50, 40, by_opencv.step, PixelFormat::kMono, 12};
  EXPECT_TRUE(samePixels(view, other, 50 * 2));
  for (const char* name : {"other.tif", "other.png"}) {
    ASSERT_TRUE(cv::imwrite((folder_.path() / name).string(), by_opencv));
    EXPECT_TRUE(samePixels(view, readImage(folder_.path() / name, PixelFormat::kMono, 12).view, 50 * 2))
        << name;
  }
}

TEST_F(ImageFileTest, ARefusalNamesTheFileAndWhatDisagrees) {
  std::vector<std::uint16_t> storage;
  writeImage(path_, noise(storage, 50, 40, 1, 16, PixelFormat::kMono));
  EXPECT_THAT(refusal([&] { (void)readImage(path_, PixelFormat::kMono, 8); }), HasSubstr("8 bit"));
  EXPECT_THAT(refusal([&] { (void)readImage(path_, PixelFormat::kMono, 12); }),
              HasSubstr("more than 12 bits"));
  EXPECT_THAT(refusal([&] { (void)readImage(path_, PixelFormat::kRgb, 16); }), HasSubstr("1 channels"));
  EXPECT_THAT(refusal([&] { (void)readImage(path_, PixelFormat::kMono, 16, 50, 41); }), HasSubstr("50 x 40"));
  EXPECT_THAT(refusal([&] { (void)readImage(folder_.path() / "no.tif", PixelFormat::kMono, 8); }),
              HasSubstr("no.tif: is absent"));
  EXPECT_THAT(refusal([&] { (void)readImage(folder_.path(), PixelFormat::kMono, 8); }),
              HasSubstr("is absent"));
}

TEST_F(ImageFileTest, TruncatedEmptyAndForeignFilesAreRefusedInSilence) {
  std::vector<std::uint16_t> storage;
  writeImage(path_, noise(storage, 137, 101, 1, 12, PixelFormat::kMono));
  const std::string whole = readText(path_);
  testing::internal::CaptureStderr();
  // libtiff writes the directory last, so every cut takes some of it.
  for (std::size_t size = 0; size < whole.size(); size += whole.size() / 50) {
    writeText(path_, whole.substr(0, size));
    EXPECT_THAT(refusal([&] { (void)readImage(path_, PixelFormat::kMono, 12); }), HasSubstr("image.tif: "));
  }
  writeText(path_, "not an image at all, but long enough to be looked at");
  EXPECT_THAT(refusal([&] { (void)readImage(path_, PixelFormat::kMono, 12); }), HasSubstr("no TIFF"));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST_F(ImageFileTest, AnyImageIsReadAsItIs) {
  cv::Mat colour(40, 50, CV_8UC3, cv::Scalar(10, 20, 200));  // blue, green, red
  for (const char* name : {"a.png", "a.jpg"}) {
    ASSERT_TRUE(cv::imwrite((folder_.path() / name).string(), colour));
    const ImageFile image = readAnyImage(folder_.path() / name);
    EXPECT_EQ(image.view.width, 50) << name;
    EXPECT_EQ(image.view.height, 40) << name;
    EXPECT_EQ(image.view.format, PixelFormat::kRgb) << name;
    EXPECT_NEAR(image.bytes[0], 200, 3) << name;
    EXPECT_NEAR(image.bytes[2], 10, 3) << name;
  }
  const std::string jpeg = readText(folder_.path() / "a.jpg");
  writeText(folder_.path() / "filled.jpg", jpeg.substr(0, 2) + "\xff\xff" + jpeg.substr(2));
  EXPECT_EQ(readAnyImage(folder_.path() / "filled.jpg").view.width, 50) << "fill bytes before a marker";

  std::vector<std::uint16_t> storage;
  const ImageView view = noise(storage, 50, 40, 1, 12, PixelFormat::kMono);
  writeImage(path_, view);
  const ImageFile image = readAnyImage(path_);
  EXPECT_EQ(image.view.bits, 12);
  EXPECT_TRUE(samePixels(view, image.view, 50 * 2));
}

TEST_F(ImageFileTest, AJpegCutShortIsRefusedInSilence) {
  cv::Mat grey(64, 64, CV_8UC1);
  cv::randu(grey, 0, 255);
  ASSERT_TRUE(cv::imwrite((folder_.path() / "a.jpg").string(), grey));
  const std::string whole = readText(folder_.path() / "a.jpg");
  testing::internal::CaptureStderr();
  for (std::size_t size = 0; size + 1 < whole.size(); size += whole.size() / 40) {
    writeText(path_, whole.substr(0, size));
    EXPECT_THAT(refusal([&] { (void)readAnyImage(path_); }), HasSubstr("image.tif: ")) << size;
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST_F(ImageFileTest, DamagedBytesNeverCrashTheReader) {
  std::vector<std::uint16_t> storage;
  writeImage(path_, noise(storage, 40, 30, 1, 12, PixelFormat::kMono));
  const std::string whole = readText(path_);
  std::mt19937 random(5);
  for (int i = 0; i < 300; ++i) {
    std::string damaged = whole;
    for (int k = 0; k < 4; ++k) damaged[random() % damaged.size()] = static_cast<char>(random());
    writeText(path_, damaged);
    (void)refusal([&] { (void)readImage(path_, PixelFormat::kMono, 12, 40, 30); });
  }
}

TEST_F(ImageFileTest, NothingHalfWrittenStaysBehind) {
  std::vector<std::uint16_t> storage;
  writeImage(path_, noise(storage, 40, 30, 1, 12, PixelFormat::kMono));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1);
}

StereoFeatureFrame sampleFrame() {
  StereoFeatureFrame frame{1360, 1024, {}};
  std::mt19937 random(3);
  std::uniform_real_distribution<float> x(0, 1359), y(0, 1023), size(8, 60);
  for (std::uint64_t i = 0; i < 300; ++i) {
    StereoFeature f{.left = {x(random), y(random)},
                    .right = {x(random), y(random)},
                    .size = size(random),
                    .place_sigma = 0.6F,
                    .match_sigma = 0.05F,
                    .colour = {static_cast<std::uint8_t>(i), 20, 255}};
    for (std::uint8_t& bin : f.descriptor) bin = static_cast<std::uint8_t>(random());
    frame.features.push_back(f);
  }
  return frame;
}

std::string refusalOf(std::vector<std::uint8_t> bytes) {
  StereoFeatureFrame frame;
  const std::string line = refusal([&] { parseFeatureFile(bytes, "pair.feat", frame); });
  EXPECT_TRUE(line.empty() || frame.features.empty());
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
