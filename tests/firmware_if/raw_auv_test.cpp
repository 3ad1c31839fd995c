#include "firmware_if/mission/log/raw_auv.hpp"

#include <gmock/gmock.h>

#include <numbers>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/units.hpp"
#include "tests/firmware_if/sample_dive.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::readText;
using test::refusal;
using test::same;
using test::writeText;
using ::testing::HasSubstr;

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
  DvlSample dvl;
  dvl.utc_ns = 1444452882'700'100'000;
  dvl.velocity = Eigen::Vector3d(0.5, -0.02, 0.01);
  dvl.range = {2.4, 2.3, 2.2, 2.1};
  dvl.altitude = 2.05;
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
  DvlSample without_bottom;
  without_bottom.utc_ns = 1444452883'000'000'000;
  without_bottom.range = {std::nullopt, std::nullopt, 3.0, 3.1};
  without_bottom.sound_speed = 1522.5;
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
