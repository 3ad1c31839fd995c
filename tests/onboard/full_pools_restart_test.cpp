// The program killed with its pools full: behind the checkpoint it has written over slots that the checkpoint
// needs, and the log reaches further than what it had consumed.
#include <gtest/gtest.h>

#include <random>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/onboard/map/moving_map.hpp"
#include "realtime/onboard/replay.hpp"
#include "realtime/onboard/slots/slot_file.hpp"
#include "recon/closure/frame_features.hpp"
#include "tests/onboard/cores_run.hpp"
#include "tests/onboard/replayed_dive.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;

constexpr int kKeyframes = 30, kPairs = 50;  // held at once

class FullPools : public ::testing::Test {
 protected:
  testing::RecordedMission mission{FATHOM_FAULTY_MISSION};
  RecordedPairs pairs{mission.paths, mission.mission, mission.rig};
  const test::TemporaryFolder folder;
  std::vector<io::OnboardInput> log;

  void SetUp() override {
    mission.config.localisation.max_keyframes = kKeyframes;
    mission.config.max_pairs = kPairs;
  }

  // Adds the mission's inputs up to a share of it.
  void addUpTo(double share) {
    const auto end = static_cast<std::size_t>(share * static_cast<double>(mission.inputs.size()));
    for (; next_ < end; ++next_) log.push_back(mission.inputs[next_]);
  }
  // Adds a mark; its place in the log.
  std::size_t addMark(io::Mark::Kind kind, std::uint64_t number) {
    log.push_back({log.back().arrival_utc_ns, io::Mark{kind, number}});
    return log.size() - 1;
  }

  [[nodiscard]] std::size_t featureBytes() const {
    return closure::slotBytes(static_cast<std::size_t>(mission.config.localisation.features));
  }
  [[nodiscard]] std::size_t meshBytes() const {
    return meshSlotBytes(static_cast<std::size_t>(mission.config.stereo.max_features));
  }
  [[nodiscard]] std::unique_ptr<MissionRun> makeRun(OnboardOutput& output, const MapSlots& slots) {
    return std::make_unique<MissionRun>(
        MissionRun::Setup{mission.config, mission.mission, mission.rig, pairs.source(), slots, {}, {}},
        output);
  }
  static void end(MissionRun& run, OnboardOutput& output) {
    run.finish(0);
    ASSERT_TRUE(run.write(0, 0));
    output.commit();
  }

  // One life of the program, from nothing or from a checkpoint.
  struct Life {
    FullPools& test;
    bool again;
    OnboardOutput output{test.folder.path() / "live", test.mission.mission.origin, {true, again}};
    SlotFile features{SlotFile::Named{test.folder.path() / "features.slots", again}, kKeyframes,
                      test.featureBytes()};
    SlotFile meshes{SlotFile::Named{test.folder.path() / "meshes.slots", again}, kPairs, test.meshBytes()};
    std::unique_ptr<MissionRun> run = test.makeRun(output, {&features, &meshes});

    void consume(std::size_t from, std::size_t to) {
      for (std::size_t i = from; i < to; ++i) run->consume(test.log[i]);
    }
    [[nodiscard]] std::vector<std::uint8_t> save() {
      std::vector<std::uint8_t> state(std::size_t{64} << 20);
      rt::StateWriter writer(state);
      EXPECT_TRUE(run->readyToSave());
      run->save(writer);
      EXPECT_FALSE(writer.full());
      state.resize(writer.size());
      return state;
    }
    void comeBackTo(std::uint64_t number, const std::vector<std::uint8_t>& state) {
      ASSERT_TRUE(run->rollBackSlots(number));
      rt::StateReader reader(state);
      ASSERT_TRUE(run->load(reader)) << reader.failure();
    }
  };

  void replayLog() {
    OnboardOutput output(folder.path() / "again", mission.mission.origin);
    SlotFile features(output.folder(), kKeyframes, featureBytes()),
        meshes(output.folder(), kPairs, meshBytes());
    RestartingRun replayed([&] { return makeRun(output, {&features, &meshes}); }, log);
    while (replayed.step()) continue;
    end(replayed.run(), output);
  }

 private:
  std::size_t next_ = 0;
};

TEST_F(FullPools, ADiveCutOffTwiceIsTheOneThatItsLogReplaysTo) {
  addUpTo(0.35);
  const std::size_t one = addMark(io::Mark::Kind::kCheckpoint, 1);
  addUpTo(0.42);
  const std::size_t two = addMark(io::Mark::Kind::kCheckpoint, 2);
  addUpTo(0.5);
  const std::size_t first = addMark(io::Mark::Kind::kRestart, 2);
  addUpTo(0.55);
  const std::size_t second = addMark(io::Mark::Kind::kRestart, 1);  // as if 2 had not been whole
  addUpTo(0.65);
  (void)addMark(io::Mark::Kind::kEnd, 0);

  std::mt19937 random(1);
  const auto between = [&](std::size_t from, std::size_t to) { return from + 1 + random() % (to - from); };
  const std::size_t killed = between(two, first), killed_again = between(first, second);
  SCOPED_TRACE(::testing::Message() << "killed behind inputs " << killed << " and " << killed_again);
  std::vector<std::uint8_t> at_one, at_two;
  {
    Life life{*this, false};
    life.consume(0, one + 1);
    ASSERT_GT(life.run->system().map().movingMap().counters().meshes_baked_in, 0u);
    ASSERT_GT(life.run->system().map().localisation()->graph().counters().keyframes_retired, 0u);
    at_one = life.save();
    life.consume(one + 1, two + 1);
    at_two = life.save();
    life.consume(two + 1, killed);
  }
  {
    Life life{*this, true};
    life.comeBackTo(2, at_two);
    life.consume(two + 1, killed_again);
  }
  {
    Life life{*this, true};
    life.comeBackTo(1, at_one);
    life.consume(one + 1, log.size());
    EXPECT_EQ(life.run->system().map().movingMap().counters().meshes_lost, 0u);
    end(*life.run, life.output);
  }
  replayLog();
  EXPECT_GE(testing::expectSameFiles(folder.path() / "live", folder.path() / "again"), 7);
}

// What a drive without protection leaves of a journal that was not flushed: records up to somewhere, rubbish
// behind them or nothing, and the machine has booted again.
TEST_F(FullPools, AfterAPowerLossAStateIsUsedIfTheSlotsHoldWhatItKnows) {
  addUpTo(0.35);
  const std::size_t one = addMark(io::Mark::Kind::kCheckpoint, 1);
  addUpTo(0.37);
  std::vector<std::uint8_t> state;
  const fs::path slots = folder.path() / "meshes.slots", journal = folder.path() / "meshes.slots.undo";
  std::uintmax_t at_mark = 0;
  {
    Life life{*this, false};
    life.consume(0, one + 1);
    state = life.save();
    at_mark = fs::file_size(journal);
    life.consume(one + 1, log.size());
  }
  const std::string written = test::readText(slots), all = test::readText(journal);
  const auto loseThePowerAt = [&](std::uintmax_t bytes, std::size_t rubbish) {
    test::writeText(slots, written);
    test::writeText(journal, all);
    fs::resize_file(journal, bytes);
    std::fstream file(journal, std::ios::in | std::ios::out | std::ios::binary);
    constexpr std::streamoff kBoot = 8;  // where the head has the boot
    file.seekp(kBoot).put('?');
    file.seekp(0, std::ios::end) << std::string(rubbish, '?');
  };
  ASSERT_GT(all.size(), at_mark + 200) << "no slot was written over";
  for (const int what : {0, 1, 2, 3}) {
    const bool lost = what / 2 > 0;
    loseThePowerAt(lost ? at_mark : all.size(), what % 2 == 0 ? 0 : 200);
    Life life{*this, true};
    EXPECT_TRUE(life.meshes.needsCheck());
    life.comeBackTo(1, state);
    EXPECT_EQ(life.run->slotsHold(), !lost);
    EXPECT_EQ(life.meshes.needsCheck(), lost);
  }
}

}  // namespace
}  // namespace fathom::onboard
