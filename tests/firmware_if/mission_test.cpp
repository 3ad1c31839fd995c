#include "firmware_if/mission/mission.hpp"

#include <gmock/gmock.h>

#include "firmware_if/mission/sensor_log.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::readText;
using test::refusal;
using test::replaced;
using test::writeText;
using ::testing::AllOf;
using ::testing::HasSubstr;

MissionConfig sampleMission() {
  MissionConfig c;
  c.vehicle_name = "sirius";
  c.vehicle_id = 7;
  c.dive_id = 4321;
  c.software_version = "0.1.0";
  c.configuration = "rate = 2\nname = \"a \\ b\"\n\ttab \x01 \xc3\xa9\n";
  c.origin = {-0.49873, 2.0131};
  c.start_utc_ns = 1700000000'123'456'789;
  c.magnetic_declination = 0.2;
  c.tide_model = "harmonic";
  c.water.sound_speed = 1521.4;
  c.water.refractive_port = "flat";
  c.dvl.phased_array = true;
  c.cameras = {"02-2051A", "02-2052B", PixelFormat::kBayerRggb, PixelFormat::kMono, 12, 2.5};
  c.T_body_cam = SE3::fromEuler(0.01, -0.02, 1.5708, {0.1, 0.25, -0.5});
  c.T_body_dvl = SE3::fromEuler(0, 0, 0.7853981634, {-0.4, 0, 0.2});
  c.time_offsets = {0.001, -0.002, 0.05, 0.01, 0.02};
  c.plan = {{0, 0}, {30.5, -2.25}};
  return c;
}

class MissionTest : public ::testing::Test {
 protected:
  void SetUp() override { writeMissionConfig(folder_.path(), sampleMission()); }
  [[nodiscard]] std::string refusalOf(const std::string& text) const {
    writeText(path_, text);
    return refusal([&] { (void)readMissionConfig(folder_.path()); });
  }
  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_.path() / "mission.toml";
};

TEST_F(MissionTest, EveryValueComesBack) {
  const MissionConfig a = sampleMission(), b = readMissionConfig(folder_.path());
  EXPECT_EQ(b.vehicle_name, a.vehicle_name);
  EXPECT_EQ(b.vehicle_id, a.vehicle_id);
  EXPECT_EQ(b.dive_id, a.dive_id);
  EXPECT_EQ(b.software_version, a.software_version);
  EXPECT_EQ(b.configuration, a.configuration);
  EXPECT_DOUBLE_EQ(b.origin.latitude, a.origin.latitude);
  EXPECT_DOUBLE_EQ(b.origin.longitude, a.origin.longitude);
  EXPECT_EQ(b.start_utc_ns, a.start_utc_ns);
  EXPECT_DOUBLE_EQ(b.magnetic_declination, a.magnetic_declination);
  EXPECT_EQ(b.tide_model, a.tide_model);
  EXPECT_EQ(b.water.sound_speed, a.water.sound_speed);
  EXPECT_EQ(b.dvl.phased_array, a.dvl.phased_array);
  EXPECT_EQ(b.water.refractive_port, a.water.refractive_port);
  EXPECT_EQ(b.cameras.left_serial, a.cameras.left_serial);
  EXPECT_EQ(b.cameras.right_serial, a.cameras.right_serial);
  EXPECT_EQ(b.cameras.left_format, a.cameras.left_format);
  EXPECT_EQ(b.cameras.right_format, a.cameras.right_format);
  EXPECT_EQ(b.cameras.bits, a.cameras.bits);
  EXPECT_EQ(b.cameras.rate_hz, a.cameras.rate_hz);
  EXPECT_LT((b.T_body_cam.inverse() * a.T_body_cam).log().norm(), 1e-11);
  EXPECT_LT((b.T_body_dvl.inverse() * a.T_body_dvl).log().norm(), 1e-11);
  EXPECT_LT(b.T_body_usbl.log().norm(), 1e-11);
  EXPECT_EQ(b.time_offsets.left_camera, a.time_offsets.left_camera);
  EXPECT_EQ(b.time_offsets.right_camera, a.time_offsets.right_camera);
  EXPECT_EQ(b.time_offsets.dvl, a.time_offsets.dvl);
  EXPECT_EQ(b.time_offsets.compass, a.time_offsets.compass);
  EXPECT_EQ(b.time_offsets.depth, a.time_offsets.depth);
  ASSERT_EQ(b.plan.size(), 2u);
  EXPECT_EQ(b.plan[1].north, 30.5);
  EXPECT_EQ(b.plan[1].east, -2.25);
}

TEST_F(MissionTest, WhatWasReadIsWrittenBackToTheByte) {
  const std::string first = readText(path_);
  writeMissionConfig(folder_.path(), readMissionConfig(folder_.path()));
  EXPECT_EQ(readText(path_), first);
}

TEST_F(MissionTest, AMistakeInTheFileIsRefusedWithItsLineAndKey) {
  const std::string good = readText(path_);
  EXPECT_THAT(refusalOf(replaced(good, "tide_model", "tidemodel")),
              AllOf(HasSubstr("line"), HasSubstr("'tidemodel'")));
  EXPECT_THAT(refusalOf(replaced(good, "dive_id = 4321", "")), HasSubstr("'dive_id': is missing"));
  EXPECT_THAT(refusalOf(replaced(good, "4321", "65536")), HasSubstr("out of range"));
  EXPECT_THAT(refusalOf(replaced(good, "4321", "'x'")), HasSubstr("whole number"));
  EXPECT_THAT(refusalOf(replaced(good, "bits = 12", "bits = 11")), HasSubstr("8, 10, 12 or 16"));
  EXPECT_THAT(refusalOf(replaced(good, "\"bayer-rggb\"", "\"bayer\"")), HasSubstr("bayer-rggb"));
  EXPECT_THAT(refusalOf(replaced(good, "123456789Z", "123456789+10:00")), HasSubstr("UTC"));
  EXPECT_THAT(refusalOf(replaced(good, "vehicle_name = \"sirius\"", "vehicle_name = \"../x\"")),
              HasSubstr("letters"));
  EXPECT_THAT(refusalOf(replaced(good, "[extrinsics.T_body_usbl]", "[extrinsics.T_body_ship]")),
              HasSubstr("T_body_usbl"));
  EXPECT_THAT(refusalOf(replaced(good, "north_m = 30.5", "north_m = nan")), HasSubstr("plan.north_m"));
  EXPECT_THAT(refusalOf(replaced(good, "sound_speed_mps = 1521.4", "sound_speed_mps = 15214")),
              HasSubstr("range"));
}

TEST_F(MissionTest, AnAbsentEmptyCutOrForeignFileIsRefused) {
  const std::string good = readText(path_);
  EXPECT_THAT(refusalOf(""), HasSubstr("mission.toml: is empty"));
  EXPECT_THAT(refusalOf(good.substr(0, good.size() / 2)), HasSubstr("mission.toml: "));
  EXPECT_THAT(refusalOf(std::string("\x89PNG\r\n\x1a\n\0\0\0", 11)), HasSubstr("is not TOML"));
  EXPECT_THAT(refusalOf(std::string(5000, '[')), HasSubstr("is not TOML"));
  std::filesystem::remove(path_);
  EXPECT_THAT(refusal([&] { (void)readMissionConfig(folder_.path()); }), HasSubstr("is absent"));
  EXPECT_THAT(refusal([&] { (void)readMissionConfig("/nowhere"); }), HasSubstr("/nowhere/mission.toml"));
}

TEST_F(MissionTest, AMissionThatNobodyCouldReadIsNotWritten) {
  const std::string before = readText(path_);
  MissionConfig config = sampleMission();
  config.cameras.bits = 9;
  EXPECT_THAT(refusal([&] { writeMissionConfig(folder_.path(), config); }), HasSubstr("bits"));
  config = sampleMission();
  config.configuration = "not UTF-8: \xff\xfe";
  EXPECT_THAT(refusal([&] { writeMissionConfig(folder_.path(), config); }), HasSubstr("mission.toml"));
  config = sampleMission();
  config.origin.latitude = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(refusal([&] { writeMissionConfig(folder_.path(), config); }), HasSubstr("origin_latitude"));
  EXPECT_EQ(readText(path_), before);
}

TEST_F(MissionTest, TheRawAuvIsFoundIfThereIsOne) {
  const MissionPaths paths(folder_.path());
  EXPECT_FALSE(paths.rawAuv());
  EXPECT_FALSE(MissionPaths("/nowhere").rawAuv());
  writeText(folder_.path() / "r1.RAW.auv", "x");
  EXPECT_EQ(paths.rawAuv(), folder_.path() / "r1.RAW.auv");
  writeText(folder_.path() / "r2.RAW.auv", "x");
  EXPECT_THAT(refusal([&] { (void)paths.rawAuv(); }), HasSubstr("leave one"));
}

constexpr std::int64_t kFolderStart_ns = 1'700'000'000'000'000'000;

MissionConfig simpleMission() {
  MissionConfig mission;
  mission.origin = {-0.49, 2.01};
  mission.start_utc_ns = kFolderStart_ns;
  return mission;
}

TEST(MissionFolder, TheRawAuvIsNamedByVehicleAndStartAndHoldsTheLogsSamples) {
  const test::TemporaryFolder parent;
  const auto folder = parent.path() / "dive";
  prepareMissionFolder(folder, simpleMission(), {});
  {
    SensorLogWriter log(MissionPaths(folder).log());
    log.write(kFolderStart_ns + 5, DepthSample{kFolderStart_ns, 3.0});
  }
  deriveRawAuv(folder);
  const auto raw_auv = MissionPaths(folder).rawAuv();
  ASSERT_TRUE(raw_auv);
  EXPECT_EQ(raw_auv->filename(), "sirius_20231114_221320.RAW.auv");
  EXPECT_THAT(readText(*raw_auv), HasSubstr("PAROSCI: 1700000000.000000000 3\n"));
}

TEST(MissionFolder, AFolderThatIsNoMissionIsLeftAlone) {
  const test::TemporaryFolder parent;
  const auto prepare = [&](const char* name) {
    return refusal([&] { prepareMissionFolder(parent.path() / name, simpleMission(), {}); });
  };
  writeText(parent.path() / "dive/img/holiday.tif", "keep");
  EXPECT_THAT(prepare("dive"), HasSubstr("holds no mission.toml"));
  EXPECT_EQ(readText(parent.path() / "dive/img/holiday.tif"), "keep");
  writeText(parent.path() / "file", "x");
  EXPECT_THAT(prepare("file/dive"), HasSubstr("cannot be made"));
}

TEST(MissionFolder, AHalfConfigurationThatAnEarlierTryLeftIsNoOtherThing) {
  const test::TemporaryFolder parent;
  writeText(parent.path() / "dive/mission.toml.tmp", "half");
  prepareMissionFolder(parent.path() / "dive", simpleMission(), {});
  EXPECT_EQ(readMissionConfig(parent.path() / "dive").start_utc_ns, kFolderStart_ns);
  EXPECT_FALSE(std::filesystem::exists(parent.path() / "dive/mission.toml.tmp"));
}

TEST(MissionFolder, TheRawAuvThatIsGivenUpLeavesNoFile) {
  const test::TemporaryFolder parent;
  const auto folder = parent.path() / "dive";
  prepareMissionFolder(folder, simpleMission(), {});
  {
    SensorLogWriter log(MissionPaths(folder).log());
    for (int i = 0; i < 1000; ++i) log.write(kFolderStart_ns + i, DepthSample{kFolderStart_ns + i, 3.0});
  }
  int asked = 0;
  EXPECT_FALSE(deriveRawAuv(folder, [&] { return ++asked < 3; }));
  EXPECT_EQ(asked, 3);
  EXPECT_FALSE(MissionPaths(folder).rawAuv());
  for (const auto& file : std::filesystem::directory_iterator(folder))
    EXPECT_THAT(file.path().filename().string(), ::testing::Not(HasSubstr("RAW.auv")));
  EXPECT_TRUE(deriveRawAuv(folder, [] { return true; }));
  EXPECT_TRUE(MissionPaths(folder).rawAuv());
}

}  // namespace
}  // namespace fathom::io
