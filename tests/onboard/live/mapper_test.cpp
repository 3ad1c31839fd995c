// What happens to the mapper process reaches neither navigation nor recording, and the recording replays to
// the same bytes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "tests/onboard/live/dived_mission.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;
using test::DivedMission;

class Mapper : public testing::Test {
 protected:
  void TearDown() override {
    if (HasFailure()) return;  // left to be looked at
    fs::remove_all(folder);
    fs::remove(folder.string() + ".toml");
  }
  // Dives until some pairs are mapped.
  void begin(double stuck_after_s = 30) {
    live = dive.start(folder, true, "", stuck_after_s);
    ASSERT_TRUE(live->arm().armed());
    ASSERT_TRUE(dive.superviseUntil(
        *live, [&] { return test::mapOf(*live).pairs >= 4; }, 60));
  }
  [[nodiscard]] bool maps() const {
    return phase() == MapperPhase::kRunning && live->parts().read("mapper").state == PartState::kRunning;
  }
  [[nodiscard]] MapperPhase phase() const { return test::phaseOf(*live); }
  // To the last pair of the mission, and the replay.
  void finish() {
    (void)dive.superviseUntil(
        *live, [&] { return test::mapOf(*live).pairs >= kPairs; }, std::max(dive.leftSeconds(), 0.0) + 4);
    dive.supervise(*live, 4);
    const LiveSystem::End end = live->end(240);
    EXPECT_THAT(end.left_out, testing::IsEmpty());
    EXPECT_TRUE(end.mapped);
    const io::Recorder::Counters recorded = live->recorder().counters();
    EXPECT_EQ(recorded.images, 2 * kPairs);
    EXPECT_EQ(recorded.inputs_dropped + recorded.decisions_dropped, 0U);
    EXPECT_EQ(live->hardCost().heap_calls, 0U);
    EXPECT_EQ(test::mapOf(*live).pairs, kPairs);
    if (end.mapped) {
      EXPECT_THAT(test::replayDifferences(folder), testing::IsEmpty());
    }
  }

  static constexpr std::uint64_t kPairs = 30;  // of reef-quick
  DivedMission dive{FATHOM_REEF_MISSION};
  fs::path folder =
      fs::path(testing::TempDir()) /
      (std::string("fathom_mapper_") + testing::UnitTest::GetInstance()->current_test_info()->name());
  std::unique_ptr<LiveSystem> live;
};

class MapperSignal : public Mapper, public testing::WithParamInterface<int> {};

TEST_P(MapperSignal, MapperThatDiesComesBackWithEveryPairAndTheDiveReplaysToTheSameBytes) {
  ASSERT_NO_FATAL_FAILURE(begin());
  const pid_t first = live->mapperPid();
  ASSERT_EQ(::kill(first, GetParam()), 0);
  EXPECT_TRUE(dive.superviseUntil(
      *live, [&] { return live->mapperPid() != first && maps(); }, 60));
  EXPECT_TRUE(dive.saidThat("the mapper is lost (ended by signal " + std::to_string(GetParam())));
  EXPECT_EQ(live->supervisor().mapperStarts(), 2U);
  finish();
}
INSTANTIATE_TEST_SUITE_P(Signals, MapperSignal, testing::Values(SIGKILL, SIGSEGV, SIGABRT));

TEST_F(Mapper, OneThatHangsIsKilledAndComesBack) {
  // Of the vehicle's time, which runs four times as fast.
  ASSERT_NO_FATAL_FAILURE(begin(12));
  const pid_t first = live->mapperPid();
  ASSERT_EQ(::kill(first, SIGSTOP), 0);
  EXPECT_TRUE(dive.superviseUntil(
      *live, [&] { return live->mapperPid() != first && maps(); }, 120));
  EXPECT_TRUE(dive.saidThat("the mapper got no further for"));
  finish();
}

TEST_F(Mapper, DyingAgainAndAgainCostsNoPair) {
  ASSERT_NO_FATAL_FAILURE(begin());
  for (int k = 0; k < 4; ++k) {
    const pid_t before = live->mapperPid();
    ASSERT_EQ(::kill(before, SIGKILL), 0);
    // The second and the fourth die before they have caught up.
    EXPECT_TRUE(dive.superviseUntil(
        *live, [&] { return live->mapperPid() > 0 && live->mapperPid() != before && (k % 2 == 1 || maps()); },
        120));
  }
  EXPECT_TRUE(dive.superviseUntil(
      *live, [&] { return maps(); }, 120));
  finish();
}

TEST_F(Mapper, WhileThereIsNoneTheVehicleSaysSo) {
  ASSERT_NO_FATAL_FAILURE(begin());
  ASSERT_EQ(::kill(live->mapperPid(), SIGSTOP), 0);
  ASSERT_EQ(::kill(live->mapperPid(), SIGKILL), 0);
  EXPECT_TRUE(dive.superviseUntil(
      *live, [&] { return live->parts().read("mapper").state != PartState::kRunning; }, 8));
  EXPECT_TRUE(dive.superviseUntil(
      *live, [&] { return maps(); }, 60));
  finish();
  std::uint64_t damaged = 0;
  int lost = 0, restarts = 0, reported = 0;
  for (const io::OnboardInput& input : io::readOnboardInputs(folder, damaged)) {
    const auto* mark = std::get_if<io::Mark>(&input.what);
    if (mark == nullptr) continue;
    lost += mark->kind == io::Mark::Kind::kMapperLost;
    restarts += mark->kind == io::Mark::Kind::kRestart;
    reported += mark->kind == io::Mark::Kind::kHealth && (mark->number & telemetry::kHealthNoMap) != 0;
  }
  EXPECT_EQ(lost, 1);
  EXPECT_EQ(restarts, 1);
  EXPECT_GE(reported, 1);
}

}  // namespace
}  // namespace fathom::onboard
