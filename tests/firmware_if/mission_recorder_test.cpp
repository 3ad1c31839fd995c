#include "firmware_if/mission_recorder.hpp"

#include <gmock/gmock.h>

#include "firmware_if/image_file.hpp"
#include "tests/firmware_if/sample_dive.hpp"
#include "tests/support/files.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::everyKindOfSample;
using test::readText;
using test::refusal;
using test::same;
using test::writeText;
using ::testing::HasSubstr;

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;

StereoRig sampleRig() {
  StereoRig rig;
  for (Camera* camera : {&rig.left, &rig.right}) {
    camera->width = 20;
    camera->height = 10;
    camera->fx = camera->fy = 25;
    camera->cx = 9.5;
    camera->cy = 4.5;
  }
  rig.T_right_left = SE3(Eigen::Quaterniond::Identity(), {-0.07, 0, 0});
  return rig;
}

MissionConfig sampleMission(std::uint16_t dive_id = 12) {
  MissionConfig mission;
  mission.dive_id = dive_id;
  mission.origin = {-0.49, 2.01};
  mission.start_utc_ns = kStart;
  return mission;
}

std::size_t countSamples(const std::filesystem::path& folder) {
  SensorLogReader reader(folder);
  std::size_t count = 0;
  while (reader.next()) ++count;
  EXPECT_EQ(reader.damagedEntries(), 0u);
  return count;
}

class MissionRecorderTest : public ::testing::Test {
 protected:
  void record(const MissionRecorder::Config& config, bool close) const {
    MissionRecorder recorder(folder_, sampleMission(), sampleRig(), config);
    std::int64_t arrival = kStart;
    for (const SensorSample& sample : everyKindOfSample()) recorder.record(arrival += 700'000'000, sample);
    if (close) recorder.close();
  }
  test::TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_.path() / "dive";
};

TEST_F(MissionRecorderTest, TheFolderHoldsAllThatAMissionIs) {
  const std::vector<std::uint16_t> pixels(200, 4095);
  {
    MissionRecorder recorder(folder_, sampleMission(), sampleRig(), {});
    recorder.record(kStart + 5, DepthSample{kStart, 3.0});
    const std::uint8_t bytes[] = {1, 2};
    recorder.recordRaw(kStart + 6, "RAW_CAN", bytes);
    recorder.recordImage(kStart + 7, {kStart + 1'000'000, CameraSide::kRight, "", 0.001},
                         {pixels.data(), 20, 10, 40, PixelFormat::kMono, 12});
    recorder.close();
  }
  EXPECT_EQ(readMissionConfig(folder_).dive_id, 12);
  EXPECT_NEAR(readStereoCalib(MissionPaths(folder_).calib()).baseline(), 0.07, 1e-12);
  SensorLogReader reader(folder_);
  const auto depth = reader.next();
  ASSERT_TRUE(depth);
  EXPECT_EQ(depth->arrival_utc_ns, kStart + 5);
  const auto image = reader.next();
  ASSERT_TRUE(image);
  const auto& event = std::get<ImageEvent>(image->sample);
  EXPECT_EQ(event.file_name, "PR_20231114_221320_001_RM16.tif");
  EXPECT_NO_THROW(
      (void)readImage(MissionPaths(folder_).images() / event.file_name, PixelFormat::kMono, 12, 20, 10));
  const auto raw_auv = MissionPaths(folder_).rawAuv();
  ASSERT_TRUE(raw_auv);
  EXPECT_EQ(raw_auv->filename(), "sirius_20231114_221320.RAW.auv");
  EXPECT_THAT(readText(*raw_auv), HasSubstr("PAROSCI: 1700000000.000000000 3\n"));
}

TEST_F(MissionRecorderTest, RecordingGoesOnInTheSameDiveAfterARestart) {
  record({}, false);
  EXPECT_FALSE(MissionPaths(folder_).rawAuv());
  record({}, true);
  EXPECT_EQ(countSamples(folder_), 2 * everyKindOfSample().size());
  EXPECT_THAT(refusal([&] { MissionRecorder other(folder_, sampleMission(13), sampleRig(), {}); }),
              HasSubstr("dive 12; give each dive its own folder"));
}

TEST_F(MissionRecorderTest, BeginningAnewLeavesNothingOfTheOldRecording) {
  MissionRecorder::Config config;
  config.replace = true;
  record(config, true);
  writeText(MissionPaths(folder_).images() / "PR_20231114_221320_123_LC16.tif", "old");
  record(config, true);
  EXPECT_EQ(countSamples(folder_), everyKindOfSample().size());
  EXPECT_TRUE(std::filesystem::is_empty(MissionPaths(folder_).images()));
  EXPECT_TRUE(MissionPaths(folder_).rawAuv());
}

TEST_F(MissionRecorderTest, AFolderThatIsNoMissionIsLeftAlone) {
  MissionRecorder::Config config;
  config.replace = true;
  std::filesystem::create_directories(folder_ / "img");
  writeText(folder_ / "img" / "holiday.tif", "keep");
  EXPECT_THAT(refusal([&] { record(config, true); }), HasSubstr("holds no mission.toml"));
  EXPECT_EQ(readText(folder_ / "img" / "holiday.tif"), "keep");
  writeText(parent_.path() / "file", "x");
  EXPECT_THAT(
      refusal([&] { MissionRecorder r(parent_.path() / "file" / "dive", sampleMission(), sampleRig(), {}); }),
      HasSubstr("cannot be made"));
}

TEST_F(MissionRecorderTest, TheSameDiveMakesTheSameBytes) {
  MissionRecorder::Config config;
  config.replace = true;
  record(config, true);
  const MissionPaths paths(folder_);
  const std::string log = readText(paths.log()), text = readText(*paths.rawAuv());
  record(config, true);
  EXPECT_EQ(readText(paths.log()), log);
  EXPECT_EQ(readText(*paths.rawAuv()), text);
}

}  // namespace
}  // namespace fathom::io
