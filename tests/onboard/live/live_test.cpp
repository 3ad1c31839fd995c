#include <gmock/gmock.h>

#include <csignal>
#include <set>

#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/replay.hpp"
#include "tests/onboard/live/dived_mission.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

std::set<std::string> filesIn(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename());
  return names;
}

// Dives live in `folder` with the devices of a recorded mission, `rate` times as fast.
struct Dive {
  fs::path folder = fs::path(testing::TempDir()) / "fathom_live_dive";
  std::uint64_t pairs = 0, starts = 0, input_refused = 0;
  rt::ThreadCost hard_cost;
  bool mapped = false;
  double mapper_share = 0;  // of its planned memory that it uses

  void run(double rate, const test::PlayedOptions& played_options = {}) {
    const fs::path mission_folder = FATHOM_REEF_MISSION;
    const LiveSetup setup = test::liveSetup(mission_folder, folder, true);
    rt::VehicleClock clock(rt::VehicleClock::systemOffsetNs(), rate);
    const test::PlayedMission played(mission_folder, clock, 2.0 * rate);
    LiveSystem live(
        setup, test::playedDevices(played, mission_folder, setup.mission, setup.rig, clock, played_options),
        clock);
    ASSERT_TRUE(live.arm().armed());
    const std::int64_t over =
        clock.utcNs() + static_cast<std::int64_t>((played.lengthSeconds() + 3 * rate) * 1e9);
    while (clock.utcNs() < over) {
      (void)live.supervise();
      clock.sleepUntil(clock.monotonicNs() + static_cast<std::int64_t>(2e8 * rate));
    }
    const LiveSystem::End end = live.end(60 * rate);
    for (const std::string& line : end.left_out) ADD_FAILURE() << line;
    hard_cost = live.hardCost();
    MapState map;
    EXPECT_TRUE(live.mapper().up().readMap(map));
    input_refused = map.inputs_skipped + live.recorder().counters().inputs_dropped;
    mapped = end.mapped;
    pairs = map.pairs;
    starts = live.supervisor().mapperStarts();
    for (std::size_t i = 0; i < live.budget().pools(); ++i)
      if (const rt::MemoryBudget::Row row = live.budget().read(i);
          std::string_view(row.name) == "mapper process")
        mapper_share = static_cast<double>(row.use.used) / static_cast<double>(row.planned);
  }
};

// The promise that everything else rests on: what the vehicle did can be done again from its log.
TEST(Live, recordingReplaysToTheSameBytes) {
  Dive dive;
  dive.run(4, test::PlayedOptions{.lost_left = 7, .scratch = {}});
  ASSERT_TRUE(dive.mapped);
  EXPECT_GT(dive.pairs, 10U);
  EXPECT_EQ(dive.starts, 1U);
  EXPECT_EQ(dive.input_refused, 0U);
  EXPECT_EQ(dive.hard_cost.heap_calls, 0U);
  EXPECT_GT(dive.mapper_share, 0.8);
  EXPECT_LT(dive.mapper_share, 1.1);  // what it shares with the vehicle is in other rows

  ReplayOptions options_again{.mission = dive.folder,
                              .config = dive.folder.string() + ".toml",
                              .out = fs::path(testing::TempDir()) / "fathom_live_dive_again",
                              .link = {}};
  const ReplaySummary again = replay(options_again);
  EXPECT_EQ(again.pairs, dive.pairs);
  const std::set<std::string> once = filesIn(dive.folder / "onboard");
  for (const std::string& name : once) {
    if (name == "timing.json" || name == "live.json") continue;
    EXPECT_TRUE(test::readText(dive.folder / "onboard" / name) == test::readText(*options_again.out / name))
        << name << " differs: " << dive.folder << ", " << *options_again.out;
  }
  EXPECT_TRUE(once.count("map.ply") && once.count("stereo_pose_est.data") && once.count("packets.bin"));
  if (HasFailure()) return;  // leave them to be looked at
  fs::remove_all(dive.folder);
  fs::remove_all(*options_again.out);
  fs::remove(*options_again.config);
}

// What happens to the mapper process reaches neither navigation nor recording, and the recording replays to
// the same bytes.

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
        *live, [&] { return test::mapOf(*live).pairs + test::mapOf(*live).pairs_shed >= kPairs; },
        std::max(dive.leftSeconds(), 0.0) + 4);
    dive.supervise(*live, 4);
    const LiveSystem::End end = live->end(240);
    EXPECT_THAT(end.left_out, testing::IsEmpty());
    EXPECT_TRUE(end.mapped);
    const io::Recorder::Counters recorded = live->recorder().counters();
    EXPECT_EQ(recorded.images, 2 * kPairs);
    EXPECT_EQ(recorded.inputs_dropped + recorded.decisions_dropped, 0U);
    EXPECT_EQ(live->hardCost().heap_calls, 0U);
    // Every pair but those that the overload rule shed, as it may on a machine that has no time.
    EXPECT_FALSE(dive.saidThat("which is left out"));
    EXPECT_EQ(test::mapOf(*live).inputs_skipped, 0U);
    EXPECT_EQ(test::mapOf(*live).pairs + decidedToDrop(), kPairs);
    if (end.mapped) {
      EXPECT_THAT(test::replayDifferences(folder), testing::IsEmpty());
    }
  }
  [[nodiscard]] std::uint64_t decidedToDrop() const {
    std::uint64_t damaged = 0, dropped = 0;
    for (const io::OnboardInput& input : io::readOnboardInputs(folder, damaged)) {
      const auto* decision = std::get_if<io::Decision>(&input.what);
      dropped += decision != nullptr && decision->dropped;
    }
    return dropped;
  }

  static constexpr std::uint64_t kPairs = 30;  // of reef-quick
  test::DivedMission dive{FATHOM_REEF_MISSION};
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

// The program comes back with what an earlier run left of a dive, whatever state that is in.

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
  EXPECT_THAT(test::refusal([&] { (void)dive_->start(folder, false); }), HasSubstr("this dive has ended"));
}

}  // namespace
}  // namespace fathom::onboard
