#include "firmware_if/mission/images/image_file.hpp"

#include <gmock/gmock.h>

#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <random>

#include "realtime/base/civil_time.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::readText;
using test::refusal;
using test::writeText;
using ::testing::HasSubstr;

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

}  // namespace
}  // namespace fathom::io
