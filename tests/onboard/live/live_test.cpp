#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "realtime/onboard/live/live_system.hpp"
#include "realtime/onboard/replay.hpp"
#include "tests/onboard/live/played_devices.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;

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
  }
};

// The promise that everything else rests on: what the vehicle did can be done again from its log.
TEST(Live, recordingReplaysToTheSameBytes) {
  Dive dive;
  test::PlayedOptions options;
  options.lost_left = 7;
  dive.run(4, options);
  ASSERT_TRUE(dive.mapped);
  EXPECT_GT(dive.pairs, 10U);
  EXPECT_EQ(dive.starts, 1U);
  EXPECT_EQ(dive.input_refused, 0U);
  EXPECT_EQ(dive.hard_cost.heap_calls, 0U);

  ReplayOptions options_again;
  options_again.mission = dive.folder;
  options_again.config = dive.folder.string() + ".toml";
  options_again.out = fs::path(testing::TempDir()) / "fathom_live_dive_again";
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

}  // namespace
}  // namespace fathom::onboard
