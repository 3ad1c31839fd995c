#include <gtest/gtest.h>

#include "realtime/onboard/replay.hpp"
#include "tests/onboard/replayed_dive.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

// Rendered before this test runs: a DVL silent for 60 s, a compass that jumps by 20 degrees, one USBL fix in
// ten wild; stereo features instead of images.
const std::filesystem::path kMission = FATHOM_FAULTY_MISSION;

ReplaySummary run(const std::filesystem::path& out, bool no_slam) {
  ReplayOptions options{.mission = kMission, .config = {}, .out = out, .no_slam = no_slam, .link = {}};
  return replay(options);
}

TEST(Faults, DeadJumpingAndOutlyingSensorsCostCentimetresAndTwoReplaysAgreeInEveryByte) {
  const test::TemporaryFolder folder;
  const ReplaySummary summary = run(folder.path() / "a", false);
  EXPECT_EQ(summary.unreadable_images, 0u);
  EXPECT_EQ(summary.pairs_used, summary.pairs);
  run(folder.path() / "b", false);
  run(folder.path() / "reckoned", true);
  EXPECT_GT(testing::trackError(kMission, folder.path() / "reckoned").shape, 1.0);
  EXPECT_LT(testing::trackError(kMission, folder.path() / "a").shape, 0.05);
  EXPECT_LT(testing::trackError(kMission, folder.path() / "a").absolute, 0.5);  // as GPS has it
  testing::expectSameFiles(folder.path() / "a", folder.path() / "b");
}

}  // namespace
}  // namespace fathom::onboard
