// The program comes back with what an earlier run left of a dive, whatever state that is in.
#include <gtest/gtest.h>

#include <fstream>

#include "realtime/onboard/live/live_system.hpp"
#include "realtime/onboard/replay.hpp"
#include "tests/onboard/live/played_devices.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;

constexpr double kRate = 4;
constexpr double kFrom_s = 39;  // in the mission: the seafloor comes into sight
constexpr double kFirstLife_s = 10, kSecondLife_s = 4;

bool saidThat(const LiveSystem& live, const char* what) {
  for (const std::string& line : live.resumeSaid())
    if (line.find(what) != std::string::npos) return true;
  return false;
}

// A dive of which one run of the program was, and ended without a word; each test has a copy of what it left.
class Resume : public testing::Test {
 protected:
  static fs::path left() { return fs::path(testing::TempDir()) / "fathom_resume_left"; }
  static void SetUpTestSuite() {
    clock_ = std::make_unique<rt::VehicleClock>(rt::VehicleClock::systemOffsetNs(), kRate);
    played_ = std::make_unique<test::PlayedMission>(FATHOM_REEF_MISSION, *clock_, 2 * kRate - kFrom_s);
    const auto live = start(left(), true);
    dive(*live, 2 * kRate + kFirstLife_s);
  }
  static void TearDownTestSuite() {
    fs::remove_all(left());
    played_.reset();
    clock_.reset();
  }

  static std::unique_ptr<LiveSystem> start(const fs::path& folder, bool anew, const std::string& text = "") {
    LiveSetup setup = test::liveSetup(FATHOM_REEF_MISSION, folder, anew);
    setup.config.live.checkpoint_s = 2;
    setup.config.text = text;
    const std::int64_t now = clock_->utcNs();
    for (played_->first = 0; played_->first < played_->inputs.size() && played_->dueNs(played_->first) < now;)
      ++played_->first;
    LiveDevices devices =
        test::playedDevices(*played_, FATHOM_REEF_MISSION, setup.mission, setup.rig, *clock_, {});
    return std::make_unique<LiveSystem>(std::move(setup), std::move(devices), *clock_);
  }
  static void dive(LiveSystem& live, double seconds) {
    ASSERT_TRUE(live.arm().armed());
    const std::int64_t end = clock_->utcNs() + static_cast<std::int64_t>(seconds * 1e9);
    while (clock_->utcNs() < end) {
      (void)live.supervise();
      clock_->sleepUntil(clock_->monotonicNs() + static_cast<std::int64_t>(5e7 * kRate));
    }
  }

  void SetUp() override {
    fs::remove_all(folder);
    fs::copy(left(), folder, fs::copy_options::recursive);
  }
  void TearDown() override { fs::remove_all(folder); }

  static std::unique_ptr<rt::VehicleClock> clock_;
  static std::unique_ptr<test::PlayedMission> played_;
  fs::path folder = fs::path(testing::TempDir()) / "fathom_resume";
};
std::unique_ptr<rt::VehicleClock> Resume::clock_;
std::unique_ptr<test::PlayedMission> Resume::played_;

TEST_F(Resume, GoesOnFromTheNewestCheckpoint) {
  const auto live = start(folder, false);
  EXPECT_TRUE(live->resumed());
  EXPECT_GT(live->resumedFrom(), 0U);
  EXPECT_GT(live->run().inputs(), 0U);
  EXPECT_TRUE(live->resumeSaid().empty());
}

TEST_F(Resume, DamagedCheckpointsArePassedOverForTheLog) {
  for (const char* name : {"checkpoint-0.bin", "checkpoint-1.bin"})
    fs::resize_file(folder / "state" / name, fs::file_size(folder / "state" / name) / 2);
  const auto live = start(folder, false);
  EXPECT_TRUE(live->resumed());
  EXPECT_EQ(live->resumedFrom(), 0U);
  EXPECT_TRUE(saidThat(*live, "checkpoint-0.bin: passed over"));
  EXPECT_TRUE(saidThat(*live, "checkpoint-1.bin: passed over"));
}

TEST_F(Resume, CheckpointsOfAnotherConfigurationArePassedOverForTheLog) {
  const auto live = start(folder, false, "[link]\n");
  EXPECT_TRUE(live->resumed());
  EXPECT_EQ(live->resumedFrom(), 0U);
  EXPECT_TRUE(saidThat(*live, "another program or configuration"));
}

TEST_F(Resume, CheckpointsOfAnotherDeclinationArePassedOverForTheLog) {
  io::MissionConfig mission = io::readMissionConfig(folder);
  mission.magnetic_declination += 0.1;
  io::writeMissionConfig(folder, mission);
  const auto live = start(folder, false);
  EXPECT_TRUE(live->resumed());
  EXPECT_EQ(live->resumedFrom(), 0U);
  EXPECT_TRUE(saidThat(*live, "another program or configuration"));
}

TEST_F(Resume, WithoutCheckpointsTheLogIsEnough) {
  for (const char* name : {"checkpoint-0.bin", "checkpoint-1.bin"}) fs::remove(folder / "state" / name);
  const auto live = start(folder, false);
  EXPECT_TRUE(live->resumed());
  EXPECT_EQ(live->resumedFrom(), 0U);
}

TEST_F(Resume, ACheckpointBeyondTheLogsEndGivesWayToTheOneBefore) {
  const CheckpointNames names = checkpointNames(folder, OnboardConfig(), io::readMissionConfig(folder));
  CheckpointFiles files(folder / "state");
  std::vector<std::string> said;
  const auto newest = files.readNewest(names.configuration, names.mission, said);
  ASSERT_TRUE(newest);
  CheckpointHead beyond = newest->head;
  beyond.number += 101;  // of the other file, and beyond any mark that is logged but not saved yet
  beyond.utc_ns = clock_->utcNs();
  ASSERT_TRUE(files.write(beyond, newest->state));
  const auto live = start(folder, false);
  EXPECT_EQ(live->resumedFrom(), newest->head.number);
  EXPECT_TRUE(saidThat(*live, "the log does not reach to its mark"));
}

// Its checksums are right, but the files beside it are not those that it was saved with.
TEST_F(Resume, ACheckpointThatDoesNotLoadGivesWayToTheLogAndTheDiveReplaysToTheSameBytes) {
  fs::resize_file(folder / "onboard.tmp" / "odometry.csv", 10);
  bool mapped = false;
  {
    const auto live = start(folder, false);
    EXPECT_TRUE(live->resumed());
    EXPECT_EQ(live->resumedFrom(), 0U);
    EXPECT_TRUE(saidThat(*live, "cannot be used"));
    dive(*live, kSecondLife_s);
    EXPECT_GT(live->awaySeconds(), 0.0);
    live->stop();
    mapped = live->write();
  }
  ASSERT_TRUE(mapped);
  const fs::path config = fs::path(testing::TempDir()) / "fathom_resume.toml";
  std::ofstream(config) << test::kLivePools;
  ReplayOptions again;
  again.mission = folder;
  again.config = config;
  again.out = folder / "again";
  EXPECT_GT(replay(again).pairs, 3U);
  for (const auto& entry : fs::directory_iterator(folder / "onboard")) {
    const std::string name = entry.path().filename();
    if (name == "timing.json" || name == "live.json") continue;
    EXPECT_TRUE(test::readText(entry.path()) == test::readText(*again.out / name)) << name;
  }
  fs::remove(config);
}

}  // namespace
}  // namespace fathom::onboard
