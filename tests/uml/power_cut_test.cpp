#include "tests/uml/power_cut.hpp"

#include <gmock/gmock.h>

#include "tests/support/test_data.hpp"
#include "tests/uml/machine.hpp"

namespace fathom::uml {
namespace {

TEST(PowerCutWhileRecording, LosesNothingOlderThanASecondAndRecordingGoesOn) {
  FATHOM_REQUIRE_USER_MODE_LINUX();
  const test::TemporaryFolder folder;
  PowerCutOptions options;
  options.cut_after_s = 3.7;
  const PowerCut cut = cutPower(options, folder.path());
  EXPECT_THAT(cut.wrong, ::testing::IsEmpty());
  EXPECT_GT(cut.told_safe, 100u);
  EXPECT_GT(cut.images, 2u);
}

}  // namespace
}  // namespace fathom::uml
