#include "firmware_if/files/mission_folder.hpp"

#include <gmock/gmock.h>

#include "firmware_if/files/sensor_log.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::readText;
using test::refusal;
using test::writeText;
using ::testing::HasSubstr;

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;

MissionConfig sampleMission() {
  MissionConfig mission;
  mission.origin = {-0.49, 2.01};
  mission.start_utc_ns = kStart;
  return mission;
}

TEST(MissionFolder, TheRawAuvIsNamedByVehicleAndStartAndHoldsTheLogsSamples) {
  const test::TemporaryFolder parent;
  const auto folder = parent.path() / "dive";
  prepareMissionFolder(folder, sampleMission(), {});
  {
    SensorLogWriter log(MissionPaths(folder).log());
    log.write(kStart + 5, DepthSample{kStart, 3.0});
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
    return refusal([&] { prepareMissionFolder(parent.path() / name, sampleMission(), {}); });
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
  prepareMissionFolder(parent.path() / "dive", sampleMission(), {});
  EXPECT_EQ(readMissionConfig(parent.path() / "dive").start_utc_ns, kStart);
  EXPECT_FALSE(std::filesystem::exists(parent.path() / "dive/mission.toml.tmp"));
}

TEST(MissionFolder, TheRawAuvThatIsGivenUpLeavesNoFile) {
  const test::TemporaryFolder parent;
  const auto folder = parent.path() / "dive";
  prepareMissionFolder(folder, sampleMission(), {});
  {
    SensorLogWriter log(MissionPaths(folder).log());
    for (int i = 0; i < 1000; ++i) log.write(kStart + i, DepthSample{kStart + i, 3.0});
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
