#include "tests/uml/power_cut.hpp"

#include <gmock/gmock.h>

#include "tests/support/test_data.hpp"
#include "tests/uml/machine.hpp"

namespace fathom::uml {
namespace {

TEST(PowerCutWhileRecording, LosesNothingOlderThanASecondAndRecordingContinues) {
  FATHOM_REQUIRE_OWN_PROGRAMS_INSIDE();
  const test::TemporaryFolder folder;
  const PowerCut cut = cutPower(PowerCutOptions{.cut_after_s = 5.3, .drive_seed = 3}, folder.path());
  EXPECT_THAT(cut.wrong, ::testing::IsEmpty());
  EXPECT_TRUE(cut.began);
  EXPECT_GT(cut.durable, 0u);
  EXPECT_GT(cut.images, 0u);
}

}  // namespace
}  // namespace fathom::uml
