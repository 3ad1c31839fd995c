// The program comes back with what an earlier run left of a dive, whatever state that is in.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "realtime/base/input_error.hpp"
#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "tests/onboard/live/dived_mission.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr double kFirstLife_s = 10, kSecondLife_s = 4;

// A dive of which one run of the program was, and ended without a word; each test has a copy of what it left.
class Resume : public testing::Test {
 protected:
  static fs::path left() { return fs::path(testing::TempDir()) / "fathom_resume_left"; }
  static void SetUpTestSuite() {
    dive_ = std::make_unique<test::DivedMission>(FATHOM_REEF_MISSION);
    const auto live = dive_->start(left(), true);
    ASSERT_TRUE(live->arm().armed());
    dive_->supervise(*live, test::DivedMission::kLead_s * test::DivedMission::kRate + kFirstLife_s);
  }
  static void TearDownTestSuite() {
    fs::remove_all(left());
    dive_.reset();
  }
  void SetUp() override {
    fs::remove_all(folder);
    fs::copy(left(), folder, fs::copy_options::recursive);
  }
  void TearDown() override { fs::remove_all(folder); }

  // Starts again, until the mapper follows the present; what the two said goes to `said`.
  std::unique_ptr<LiveSystem> comeBack(const std::string& more = "") {
    testing::internal::CaptureStderr();
    auto live = dive_->start(folder, false, more);
    EXPECT_TRUE(live->resumed());
    EXPECT_TRUE(live->arm().armed());
    EXPECT_TRUE(dive_->superviseUntil(
        *live, [&] { return test::phaseOf(*live) == MapperPhase::kRunning; }, 60));
    said = testing::internal::GetCapturedStderr();
    return live;
  }
  // The checkpoint that the mapper began with; 0: none.
  static std::uint64_t begunWith(const LiveSystem& live) { return live.mapper().up().begun_with.load() - 1; }
  static void endAndReplay(LiveSystem& live, const fs::path& folder) {
    dive_->supervise(live, kSecondLife_s);
    const LiveSystem::End end = live.end(240);
    EXPECT_THAT(end.left_out, testing::IsEmpty());
    ASSERT_TRUE(end.mapped);
    EXPECT_GT(test::mapOf(live).pairs, 3U);
    EXPECT_THAT(test::replayDifferences(folder), testing::IsEmpty());
  }

  static std::unique_ptr<test::DivedMission> dive_;
  fs::path folder = fs::path(testing::TempDir()) / "fathom_resume";
  std::string said;
};
std::unique_ptr<test::DivedMission> Resume::dive_;

TEST_F(Resume, GoesOnFromTheNewestCheckpointAndReplaysToTheSameBytes) {
  const auto live = comeBack();
  EXPECT_GT(begunWith(*live), 0U);
  EXPECT_GT(live->mapper().up().position.load(), 0U);
  EXPECT_GT(live->awaySeconds(), 0.0);
  EXPECT_THAT(live->resumeSaid(), testing::IsEmpty());
  endAndReplay(*live, folder);
}

TEST_F(Resume, DamagedCheckpointsArePassedOverForTheLog) {
  for (const char* name : {"checkpoint-0.bin", "checkpoint-1.bin"})
    fs::resize_file(folder / "state" / name, fs::file_size(folder / "state" / name) / 2);
  const auto live = comeBack();
  EXPECT_EQ(begunWith(*live), 0U);
  EXPECT_THAT(said, HasSubstr("checkpoint-0.bin: passed over"));
  EXPECT_THAT(said, HasSubstr("checkpoint-1.bin: passed over"));
  endAndReplay(*live, folder);
}

TEST_F(Resume, CheckpointsOfAnotherConfigurationArePassedOverForTheLog) {
  const auto live = comeBack("[link]\n");
  EXPECT_EQ(begunWith(*live), 0U);
  EXPECT_THAT(said, HasSubstr("another program or configuration"));
}

TEST_F(Resume, CheckpointsOfAnotherDeclinationArePassedOverForTheLog) {
  io::MissionConfig mission = io::readMissionConfig(folder);
  mission.magnetic_declination += 0.1;
  io::writeMissionConfig(folder, mission);
  const auto live = comeBack();
  EXPECT_EQ(begunWith(*live), 0U);
  EXPECT_THAT(said, HasSubstr("another program or configuration"));
}

TEST_F(Resume, WithoutCheckpointsTheLogIsEnough) {
  for (const char* name : {"checkpoint-0.bin", "checkpoint-1.bin"}) fs::remove(folder / "state" / name);
  const auto live = comeBack();
  EXPECT_EQ(begunWith(*live), 0U);
}

TEST_F(Resume, ACheckpointBeyondTheLogsEndIsPassedOverForTheOneBefore) {
  const io::MissionConfig mission = io::readMissionConfig(folder);
  const CheckpointNames names =
      checkpointNames(folder, readOnboardConfig(left().string() + ".toml", mission), mission);
  CheckpointFiles files(folder / "state");
  std::vector<std::string> passed;
  const auto heads = files.usable(names.configuration, names.mission, passed);
  ASSERT_FALSE(heads.empty());
  const auto newest = files.read(heads.front().number, passed);
  ASSERT_TRUE(newest);
  CheckpointHead beyond = newest->head;
  beyond.number += 100;  // beyond any mark that is logged but not saved yet
  beyond.inputs += 100'000;
  ASSERT_TRUE(files.write(beyond, newest->state));
  const auto live = comeBack();
  EXPECT_EQ(begunWith(*live), newest->head.number);
  EXPECT_THAT(said, HasSubstr("the log does not reach to its mark"));
}

// Their checksums are right, but the files beside them are not those that they were saved with.
TEST_F(Resume, CheckpointsThatDoNotLoadArePassedOverForTheLogAndKept) {
  fs::resize_file(folder / "onboard.tmp" / "odometry.csv", 10);
  const auto live = comeBack();
  EXPECT_EQ(begunWith(*live), 0U);
  EXPECT_THAT(said, HasSubstr("cannot be used"));
  EXPECT_TRUE(fs::exists(folder / "state" / "checkpoint-0.bin"));
  EXPECT_TRUE(fs::exists(folder / "state" / "checkpoint-1.bin"));
  endAndReplay(*live, folder);
}

TEST_F(Resume, ADiveThatWasLeftContinuesAndOneThatHasEndedDoesNot) {
  {
    const auto live = comeBack();
    EXPECT_THAT(live->leave(40).left_out, testing::IsEmpty());
    EXPECT_FALSE(fs::exists(folder / "onboard"));
  }
  const auto live = comeBack();
  EXPECT_GT(begunWith(*live), 0U);
  endAndReplay(*live, folder);
  try {
    (void)dive_->start(folder, false);
    ADD_FAILURE() << "an ended dive began";
  } catch (const InputError& e) {
    EXPECT_THAT(std::string(e.what()), HasSubstr("this dive has ended"));
  }
}

}  // namespace
}  // namespace fathom::onboard
