#include <gmock/gmock.h>

#include "firmware_if/mission/log/raw_auv.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/units.hpp"
#include "tests/firmware_if/sample_dive.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::readText, test::refusal, test::replaced, test::same, test::writeText, ::testing::HasSubstr;

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
              ::testing::AllOf(HasSubstr("line"), HasSubstr("'tidemodel'")));
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
  MissionConfig made;
  made.origin = {-0.49, 2.01};
  made.start_utc_ns = kFolderStart_ns;
  return made;
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

const Geodetic kOrigin{-30.0 / kDegreesPerRadian, 115.0 / kDegreesPerRadian};

// Lines as ACFR tools and oplab_pipeline write them; spaces behind the colons differ.
constexpr const char* kLines =
    "PAROSCI: 1444452882.644 22.9\n"
    "RDI: 1444452882.7001 alt:2.05 r1:2.4 r2:2.3 r3:2.2 r4:2.1 h:90 p:-1 r:2 vx:0.5 vy:-0.02 vz:0.01 "
    "nx:-9999 "
    "ny:-9999 nz:-9999 COG:-9999 SOG:-9999 bt_status:0 h_true:91.5 p_gimbal:-9999 sv: -9999\n"
    "RDI: 1444452883.0 alt: -9999 r1: 0 r2:-9999 r3:3 r4:3.1 h: 90 p: -1 r: 2 vx: 0.5 vy: 0 vz: 0 bt_status: "
    "1 sv: "
    "1522.5\r\n"
    "PHINS_COMPASS: 1444452883.1 r: 1.5 p: -2.5 h: 180 std_r: 0 std_p: 0 std_h: 0\n"
    "OAS: 1444452883.2 pitch: 3\n"
    "\n"
    "SSBL_FIX: 1444452883.3 ship_x: -497.175 ship_y: 1100.43 target_x: 100 target_y: -50 target_z: 30 "
    "target_hr: 52 "
    "target_sr: 60 target_bearing: 44.2\n"
    "VIS: 1444452883.500 [1444452883.500] PR_20151010_045443_500_LC16.tif exp: 1500\n"
    "VIS: 1444452883.500 PR_20151010_045443_500_RM16.tif exp:1500\n";

class RawAuvTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::vector<SensorSample> read(const std::string& text) {
    writeText(path_, text);
    RawAuvReader reader(path_, kOrigin);
    std::vector<SensorSample> samples;
    while (auto sample = reader.next()) samples.push_back(std::move(*sample));
    skipped_ = reader.skippedLines();
    damaged_ = reader.damagedLines();
    return samples;
  }
  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_.path() / "dive.RAW.auv";
  std::uint64_t skipped_ = 0, damaged_ = 0;
};

TEST_F(RawAuvTest, EveryLineTypeIsReadInTheFilesOrder) {
  const auto samples = read(kLines);
  ASSERT_EQ(samples.size(), 7u);
  EXPECT_EQ(skipped_, 1u);
  EXPECT_EQ(damaged_, 0u);
  EXPECT_TRUE(same(samples[0], DepthSample{1444452882'644'000'000, 22.9}));
  DvlSample dvl{.utc_ns = 1444452882'700'100'000,
                .velocity = Eigen::Vector3d(0.5, -0.02, 0.01),
                .range = {2.4, 2.3, 2.2, 2.1},
                .altitude = 2.05};
  EXPECT_TRUE(same(samples[1], dvl));
  const auto& attitude = std::get<AttitudeSample>(samples[3]);
  EXPECT_NEAR(attitude.heading, std::numbers::pi, 1e-12);
  EXPECT_NEAR(attitude.roll, 1.5 / kDegreesPerRadian, 1e-12);
  EXPECT_NEAR(attitude.pitch, -2.5 / kDegreesPerRadian, 1e-12);
  EXPECT_FALSE(attitude.magnetic);
  EXPECT_TRUE(same(samples[5], ImageEvent{1444452883'500'000'000, CameraSide::kLeft,
                                          "PR_20151010_045443_500_LC16.tif", 0.0015}));
  EXPECT_EQ(std::get<ImageEvent>(samples[6]).side, CameraSide::kRight);
}

TEST_F(RawAuvTest, MarkedValuesAreAbsentNotNumbers) {
  const auto samples = read(kLines);
  DvlSample without_bottom{.utc_ns = 1444452883'000'000'000,
                           .velocity = {},
                           .range = {std::nullopt, std::nullopt, 3.0, 3.1},
                           .altitude = {},
                           .sound_speed = 1522.5};
  EXPECT_TRUE(same(samples[2], without_bottom));
}

TEST_F(RawAuvTest, AFixStandsWhereItsNorthAndEastSay) {
  const auto fix = std::get<UsblFix>(read(kLines)[4]);
  const Eigen::Vector2d local = LocalTransverseMercator(kOrigin).toLocal({fix.latitude, fix.longitude});
  EXPECT_NEAR(local.x(), 100.0, 1e-6);
  EXPECT_NEAR(local.y(), -50.0, 1e-6);
  EXPECT_EQ(fix.depth, 30.0);
  EXPECT_NEAR(fix.sigma_horizontal, std::hypot(0.2, 60.0 * 0.25 / kDegreesPerRadian), 1e-9);
}

TEST_F(RawAuvTest, WithoutACompassTheDvlsOwnAttitudeIsUsed) {
  const auto samples = read("RDI: 1 alt:2 h:90 p:-1 r:2 vx:0 vy:0 vz:0 h_true:91.5\nRDI: 2 h:90 p:-1 r:2\n");
  ASSERT_EQ(samples.size(), 4u);
  EXPECT_NEAR(std::get<AttitudeSample>(samples[1]).heading, 91.5 / kDegreesPerRadian, 1e-12);
  EXPECT_FALSE(std::get<AttitudeSample>(samples[1]).magnetic);
  EXPECT_NEAR(std::get<AttitudeSample>(samples[3]).heading, 90 / kDegreesPerRadian, 1e-12);
  EXPECT_TRUE(std::get<AttitudeSample>(samples[3]).magnetic);
}

TEST_F(RawAuvTest, MalformedLinesAreCountedAndTheRestIsRead) {
  const auto samples =
      read(std::string("PAROSCI: 1 x\nPAROSCI:\nPAROSCI: 1e9 3\nRDI: 5 alt:two\nRDI: 5 alt\n") +
           "PHINS_COMPASS: 5 r: 1 p: 2\nSSBL_FIX: 5 target_x: 1 target_y: 2\nVIS: 5 x.tif exp: 3\n" +
           "VIS: 5 [5]\nPAROSCI: 99999999999999 1\nPAROSCI: 7 nan\n" + std::string(100'000, 'x') +
           "\nPAROSCI: 6 3\nPAROSCI: 7 4");
  EXPECT_EQ(damaged_, 11u);
  EXPECT_EQ(skipped_, 1u);
  ASSERT_EQ(samples.size(), 2u);
  EXPECT_TRUE(same(samples[0], DepthSample{6'000'000'000, 3}));
}

TEST_F(RawAuvTest, WhatIsWrittenIsReadBack) {
  constexpr double kDeclination = 0.1;
  {
    RawAuvWriter writer(path_, kOrigin, kDeclination);
    for (const SensorSample& sample : test::everyKindOfSample()) {
      if (std::holds_alternative<UsblFix>(sample)) {
        writer.write(
            UsblFix{1'700'000'000'123'456'796, 0, kOrigin.latitude + 1e-5, kOrigin.longitude - 1e-5, 23, 1});
      } else {
        writer.write(sample);
      }
    }
    writer.commit();
  }
  const auto samples = read(readText(path_));
  EXPECT_EQ(damaged_, 0u);
  ASSERT_EQ(samples.size(), 8u);
  const auto recorded = test::everyKindOfSample();
  EXPECT_TRUE(same(samples[0], recorded[0]));
  EXPECT_TRUE(same(samples[1], recorded[1]));
  const auto& magnetic = std::get<AttitudeSample>(samples[2]);
  EXPECT_NEAR(magnetic.heading, 6.1 + kDeclination, 1e-12);
  EXPECT_EQ(magnetic.utc_ns, 1'700'000'000'123'456'793);
  EXPECT_NEAR(std::get<AttitudeSample>(samples[3]).heading, 0.1, 1e-12);
  EXPECT_TRUE(same(samples[4], recorded[4]));
  EXPECT_NEAR(std::get<UsblFix>(samples[5]).latitude, kOrigin.latitude + 1e-5, 1e-12);
  EXPECT_TRUE(same(samples[6], recorded[9]));
  EXPECT_TRUE(same(samples[7], recorded[10]));
}

TEST_F(RawAuvTest, AMissionWithoutALogIsReadFromIt) {
  MissionConfig mission;
  mission.origin = kOrigin;
  writeText(path_, kLines);
  for (const bool described : {false, true}) {  // without mission.toml nav begins at 0 N 0 E
    if (described) writeMissionConfig(folder_.path(), mission);
    SensorLogReader reader(folder_.path());
    std::size_t count = 0;
    while (const auto entry = reader.next()) ++count;
    EXPECT_EQ(count, 7u);
    EXPECT_EQ(reader.skippedEntries(), 1u);
  }
  for (const char* nothing : {"", "no such line\n", "PAROSCI: x y\n"}) {
    writeText(path_, nothing);
    EXPECT_THAT(refusal([&] { SensorLogReader again(folder_.path()); }), HasSubstr("dive.RAW.auv: "));
  }
}

}  // namespace
}  // namespace fathom::io
