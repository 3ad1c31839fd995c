#include "recon/import/images/stereo_files.hpp"

#include <gmock/gmock.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "realtime/base/input_error.hpp"
#include "recon/import/images/name_times.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::topside {
namespace {

using testing::Contains, testing::ElementsAre, testing::HasSubstr, testing::IsEmpty;

class StereoFileNames : public testing::Test {
 protected:
  void make(const std::vector<std::string>& names) {
    for (const std::string& name : names) test::writeText(folder_.path() / name, "x");
  }
  void patterns(const std::string& left, const std::string& right) {
    options_.images.clear();
    options_.left_pattern = (folder_.path() / left).string();
    options_.right_pattern = (folder_.path() / right).string();
  }
  StereoFiles find() { return findStereoFiles(options_); }
  [[nodiscard]] std::vector<std::string> pairsOf(const StereoFiles& files) const {
    std::vector<std::string> out;
    for (const StereoFilePair& p : files.pairs) out.push_back(name(p.left) + " " + name(p.right));
    return out;
  }
  [[nodiscard]] std::string name(const std::filesystem::path& file) const {
    return file.lexically_relative(folder_.path()).generic_string();
  }

  test::TemporaryFolder folder_;
  StereoFileOptions options_{.images = {folder_.path()}};
};

TEST_F(StereoFileNames, WordsAnywhereTellLeftFromRight) {
  make({"left01.png", "right01.png", "left02.png", "cam_right_7.tif", "cam_left_7.tif", "notes.txt",
        "left/0001.png", "right/0001.png", "mosaic.png"});
  const StereoFiles files = find();
  EXPECT_THAT(pairsOf(files), ElementsAre("cam_left_7.tif cam_right_7.tif", "left/0001.png right/0001.png",
                                          "left01.png right01.png"));
  ASSERT_EQ(files.alone.size(), 1u);
  EXPECT_EQ(name(files.alone[0].file), "left02.png");
  EXPECT_EQ(files.alone[0].missing, "right");
  EXPECT_THAT(
      files.assumed,
      ElementsAre(
          "left and right images are distinguished by 'left' and 'right'", "1 other images are left out",
          "1 image without its partner is left out: left02.png",
          "no times in names or EXIF that differ: pairs are taken in order of name, half a second apart"));
}

TEST_F(StereoFileNames, ShortWordsMustStandAlone) {
  make({"coral_1_L.jpg", "coral_1_R.jpg", "coral_2_L.jpg", "coral_2_R.jpg", "L10.jpg", "R10.jpg", "lamp.jpg",
        "ramp.jpg"});
  EXPECT_THAT(pairsOf(find()),
              ElementsAre("L10.jpg R10.jpg", "coral_1_L.jpg coral_1_R.jpg", "coral_2_L.jpg coral_2_R.jpg"));
}

TEST_F(StereoFileNames, FoldersMayBeNumberedCameras) {
  make({"cam0/data/1403636579763555584.png", "cam1/data/1403636579763555584.png",
        "cam0/data/1403636579813555456.png", "cam1/data/1403636579813555456.png"});
  const StereoFiles files = find();
  EXPECT_EQ(files.pairs.size(), 2u);
  EXPECT_EQ(files.pairs[0].utc_ns, 1403636579763555584);
  EXPECT_EQ(files.pairs[1].utc_ns, 1403636579813555456);
}

TEST_F(StereoFileNames, NumbersCountAndAreNotText) {
  make({"left/9.png", "right/9.png", "left/10.png", "right/10.png", "left/100.png", "right/100.png"});
  const StereoFiles files = find();
  EXPECT_THAT(pairsOf(files), ElementsAre("left/9.png right/9.png", "left/10.png right/10.png",
                                          "left/100.png right/100.png"));
  EXPECT_FALSE(files.pairs[0].utc_ns.has_value());
}

TEST_F(StereoFileNames, OtherNamesOnEachSideArePairedByTime) {
  make({"PR_20260301_020041_206_RM16.tif", "PR_20260301_020041_214_LC16.tif",
        "PR_20260301_020049_214_LC16.tif", "PR_20260301_020051_214_LC16.tif",
        "PR_20260301_020051_209_RM16.tif"});
  const StereoFiles files = find();
  EXPECT_THAT(pairsOf(files), ElementsAre("PR_20260301_020041_214_LC16.tif PR_20260301_020041_206_RM16.tif",
                                          "PR_20260301_020051_214_LC16.tif PR_20260301_020051_209_RM16.tif"));
  ASSERT_EQ(files.alone.size(), 1u);
  EXPECT_EQ(files.pairs[1].utc_ns, 1772330451214000000);
}

TEST_F(StereoFileNames, OtherNamesWithoutTimesGoInOrderIfThereAreAsMany) {
  make({"left/a2.png", "left/a10.png", "right/b1.png", "right/b2.png"});
  const StereoFiles files = find();
  EXPECT_THAT(pairsOf(files), ElementsAre("left/a2.png right/b1.png", "left/a10.png right/b2.png"));
  EXPECT_THAT(files.assumed, Contains(HasSubstr("in order of name")));
  make({"right/b3.png"});
  EXPECT_THAT(test::refusal([&] { (void)find(); }),
              HasSubstr("no pair of a left and a right image among 5 images"));
}

TEST_F(StereoFileNames, ResultsOfRunsBeforeAreNoImages) {
  make({"left/1.png", "right/1.png"});
  const std::vector<std::string> before = find().assumed;
  make({"topside/mesh.png", "topside/tiles/0/1.jpg", "topside/tiles/1/1.jpg", "model/scene.json",
        "model/layers/left.png"});
  EXPECT_EQ(find().assumed, before);
}

TEST_F(StereoFileNames, WithoutWordsTheFixIsSaid) {
  make({"1.png", "2.png"});
  EXPECT_THAT(test::refusal([&] { (void)find(); }), HasSubstr("folders left/ and right/"));
  options_.images = {folder_.path() / "nowhere"};
  EXPECT_THAT(test::refusal([&] { (void)find(); }), HasSubstr("nowhere: is not there"));
}

TEST_F(StereoFileNames, PatternsPairTheNamesThatTheirStarsStandFor) {
  make({"a1.png", "a2.png", "a3.png", "a10.png", "b1.png", "b3.png", "b4.png", "b10.png"});
  patterns("a*.png", "b*.png");
  const StereoFiles files = find();
  EXPECT_THAT(pairsOf(files), ElementsAre("a1.png b1.png", "a3.png b3.png", "a10.png b10.png"));
  ASSERT_EQ(files.alone.size(), 2u);
  EXPECT_EQ(name(files.alone[0].file), "a2.png");
  EXPECT_EQ(name(files.alone[1].file), "b4.png");
  EXPECT_THAT(files.assumed, Contains("2 images without their partner are left out: a2.png, b4.png"));
  options_.right_pattern.clear();
  EXPECT_THROW((void)find(), InputError);
}

TEST_F(StereoFileNames, PatternsPairByNumbersOrTimesWhereTheRestOfTheNamesDiffers) {
  make({"x/frame_007_L.png", "x/frame_008_L.png", "x/frame_010_L.png", "y/frame_007_R.png",
        "y/frame_010_R.png", "y/frame_011_R.png", "x/chart.png", "y/chart.png"});
  patterns("x/*.png", "y/*.png");
  EXPECT_THAT(pairsOf(find()),
              ElementsAre("x/frame_007_L.png y/frame_007_R.png", "x/frame_010_L.png y/frame_010_R.png"));
  make({"t/GX_20240217_051549_100.png", "t/GX_20240217_051550_100.png", "t/GX_20240217_051551_100.png",
        "u/CAP_20240217_051550_120.png", "u/CAP_20240217_051551_120.png"});
  patterns("t/*", "u/*");
  EXPECT_THAT(pairsOf(find()), ElementsAre("t/GX_20240217_051550_100.png u/CAP_20240217_051550_120.png",
                                           "t/GX_20240217_051551_100.png u/CAP_20240217_051551_120.png"));
}

TEST_F(StereoFileNames, PatternsMayHoldSetsAndSpecialCharacters) {
  make({"(a).1+x.png", "(a).2+x.png", "[b]1.png", "[b]2.png", "[b]3.png"});
  patterns("(a).[0-9]+?.png", "\\[b\\]?.png");
  EXPECT_EQ(find().pairs.size(), 2u) << "by their numbers";
  patterns("(a).[[:digit:]]+x.png", "\\[b\\][!3].png");
  EXPECT_EQ(find().pairs.size(), 2u) << "in order";
}

TEST_F(StereoFileNames, PatternsPairInOrderOnlyAsManyOfBothAndSaySo) {
  make({"c3.png", "c5.png", "d8.png", "d9.png"});
  patterns("c*.png", "d*.png");
  const StereoFiles files = find();
  EXPECT_THAT(pairsOf(files), ElementsAre("c3.png d8.png", "c5.png d9.png"));
  EXPECT_THAT(files.assumed, Contains(HasSubstr("in order of name")));
  make({"d10.png"});
  EXPECT_THAT(
      test::refusal([&] { (void)find(); }),
      HasSubstr("d*.png: matches 3 images, of which none has the name, number or time of one of the 2"));
}

TEST_F(StereoFileNames, AStrayNameCostsItsPairAndNotTheTimes) {
  make({"left/20240217_051549_768.png", "right/20240217_051549_768.png", "left/20240217_051550_768.png",
        "right/20240217_051550_768.png", "left/test.png", "right/test.png"});
  const StereoFiles files = find();
  EXPECT_THAT(pairsOf(files), ElementsAre("left/20240217_051549_768.png right/20240217_051549_768.png",
                                          "left/20240217_051550_768.png right/20240217_051550_768.png"));
  EXPECT_EQ(files.pairs[0].utc_ns, 1708146949768000000);
  EXPECT_THAT(files.assumed, Contains("1 of 3 pairs has no time in its name and is left out: test.png"));
}

TEST_F(StereoFileNames, AListSaysAllOfIt) {
  make({"x/1.png", "y/17.png", "x/2.png", "y/18.png"});
  options_.images.clear();
  options_.pairs = folder_.path() / "pairs.csv";
  std::ofstream(options_.pairs) << "utc,right,left\n2024-02-17T05:15:50.25Z,y/17.png,x/1.png\n"
                                   "1708146949.768,\"y/18.png\",x/2.png\n";
  const StereoFiles files = find();
  EXPECT_THAT(pairsOf(files), ElementsAre("x/2.png y/18.png", "x/1.png y/17.png"));
  EXPECT_EQ(files.pairs[0].utc_ns, 1708146949768000000);
  EXPECT_EQ(files.pairs[1].utc_ns, 1708146950250000000);
  std::ofstream(options_.pairs) << "right,left,utc\ny/17.png,x/1.png,10.25\n";  // a clock of its own
  EXPECT_EQ(find().pairs.at(0).utc_ns, 10250000000);
  std::ofstream(options_.pairs) << "right,left,utc\ny/17.png,x/1.png,soon\n";
  EXPECT_THAT(test::refusal([&] { (void)find(); }), HasSubstr("has no time 'soon'; give"));
  std::ofstream(options_.pairs) << "right,left\ny/17.png,x/1.png\ny/17.png,x/3.png\n";
  EXPECT_THAT(test::refusal([&] { (void)find(); }), HasSubstr("pairs.csv: row 2: names"));
  std::ofstream(options_.pairs) << "right;rear\n1;2\n";
  EXPECT_THAT(test::refusal([&] { (void)find(); }),
              HasSubstr("has no column 'left'; there are: right, rear"));
}

TEST_F(StereoFileNames, ATimePatternMustFitEveryImage) {
  make({"left/dive7 05h15m49s20 17-02-2024.png", "right/dive7 05h15m49s20 17-02-2024.png"});
  options_.time_pattern = "%Hh%Mm%Ss%f %d-%m-%Y";
  EXPECT_EQ(find().pairs[0].utc_ns, 1708146949200000000);
  make({"left/other.png", "right/other.png"});
  EXPECT_THAT(test::refusal([&] { (void)find(); }), HasSubstr("does not fit other.png"));
  options_.time_pattern = "%H:%M";
  EXPECT_THAT(test::refusal([&] { (void)find(); }), HasSubstr("tells no time"));
}

// A JPEG whose EXIF holds DateTimeOriginal and SubSecTimeOriginal.
std::string jpegTaken(const std::string& time, const std::string& fraction) {
  std::vector<std::uint8_t> image;
  cv::imencode(".jpg", cv::Mat(8, 8, CV_8U, cv::Scalar(90)), image);
  const auto bytes = [](std::uint32_t value, int count) {
    std::string out;
    for (int k = 0; k < count; ++k) out += static_cast<char>(value >> (8 * k));
    return out;
  };
  const auto field = [&](std::uint32_t tag, std::uint32_t type, std::uint32_t count,
                         const std::string& value) {
    return bytes(tag, 2) + bytes(type, 2) + bytes(count, 4) + value;
  };
  const std::string last = bytes(0, 4);
  const std::string exif = std::string("Exif\0\0II*\0", 10) + bytes(8, 4) + bytes(1, 2) +
                           field(0x8769, 4, 1, bytes(26, 4)) + last + bytes(2, 2) +
                           field(0x9003, 2, 20, bytes(56, 4)) + field(0x9291, 2, 4, fraction + '\0') + last +
                           time + '\0';
  const auto length = static_cast<std::uint32_t>(exif.size() + 2);
  return std::string("\xff\xd8\xff\xe1") + static_cast<char>(length >> 8) + static_cast<char>(length) + exif +
         std::string(image.begin() + 2, image.end());
}

TEST_F(StereoFileNames, TimesAreTakenFromExifWhereNamesHaveNone) {
  for (const char* name : {"left/a.jpg", "right/a.jpg"})
    test::writeText(folder_.path() / name, jpegTaken("2017:05:22 10:01:03", "250"));
  for (const char* name : {"left/b.jpg", "right/b.jpg"})
    test::writeText(folder_.path() / name, jpegTaken("2017:05:22 10:01:02", "500"));
  const StereoFiles files = find();
  EXPECT_THAT(pairsOf(files), ElementsAre("left/b.jpg right/b.jpg", "left/a.jpg right/a.jpg"));
  ASSERT_TRUE(files.pairs[0].utc_ns && files.pairs[1].utc_ns);
  EXPECT_EQ(*files.pairs[0].utc_ns, 1495447262'500'000'000);
  EXPECT_EQ(*files.pairs[1].utc_ns, 1495447263'250'000'000);
  EXPECT_THAT(files.assumed, Contains("times are those in the left images' EXIF, as if UTC"));
}

TEST(NameTime, UsualFormsAreKnownAndFrameNumbersAreNone) {
  const auto of = [](const std::string& name) -> std::optional<std::int64_t> {
    for (const NameTime& form : NameTime::usual())
      if (const auto time = form.of(name)) return time;
    return std::nullopt;
  };
  EXPECT_EQ(of("GX_2024-02-17T05-15-49.768"), 1708146949768000000);
  EXPECT_EQ(of("20240217051549"), 1708146949000000000);
  EXPECT_EQ(of("img_20240217_051549_768_L"), 1708146949768000000);
  EXPECT_EQ(of("frame1708146949768"), 1708146949768000000);
  EXPECT_EQ(of("1708146949.76801"), 1708146949768010000);
  EXPECT_EQ(of("20240217_051549_00012"), 1708146949000000000);  // the 12th image
  EXPECT_EQ(of("20241317_051549"), std::nullopt);               // no such month
  EXPECT_EQ(of("0000012345"), std::nullopt);
}

TEST(PartnersByTime, AreFoundWhereTheClocksDriftedApartBeforeTheFirstImagesAndOverFiveHours) {
  constexpr std::int64_t kSecond = 1'000'000'000, kStart = 1'700'000'000 * kSecond;
  std::vector<std::int64_t> left, right;
  // 100 ppm; images from ten minutes on, none for a quarter of an hour, then to the end of five hours.
  for (std::int64_t half = 1200; half < 36000; ++half) {
    if (half > 3000 && half < 4800) continue;
    const std::int64_t since = half * kSecond / 2;
    left.push_back(kStart + since);
    if (half % 7 != 3) right.push_back(kStart + since + since / 10'000);
  }
  const auto partners = partnersByTime(left, right, 0.05, kStart);
  std::size_t paired = 0, wrong = 0;
  for (std::size_t k = 0; k < left.size(); ++k) {
    if (!partners[k]) continue;
    ++paired;
    const std::int64_t since = left[k] - kStart;
    wrong += right[*partners[k]] != left[k] + since / 10'000 ? 1U : 0U;
  }
  EXPECT_EQ(wrong, 0U);
  EXPECT_GE(paired + 2, right.size());
}

}  // namespace
}  // namespace fathom::topside
