#include <gtest/gtest.h>

#include "realtime/onboard/replay.hpp"
#include "tests/onboard/track_error.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::onboard {
namespace {

// Rendered before this test runs: a DVL silent for 60 s, a compass that jumps by 20 degrees, one USBL fix in
// ten wild; stereo features instead of images.
const std::filesystem::path kMission = FATHOM_FAULTY_MISSION;

ReplaySummary run(const std::filesystem::path& out, bool no_slam) {
  ReplayOptions options;
  options.mission = kMission;
  options.out = out;
  options.no_slam = no_slam;
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
  for (const auto& entry : std::filesystem::directory_iterator(folder.path() / "a")) {
    const auto name = entry.path().filename();
    if (name == "timing.json") continue;
    EXPECT_EQ(test::readText(entry.path()), test::readText(folder.path() / "b" / name)) << name;
  }
}

}  // namespace
}  // namespace fathom::onboard
