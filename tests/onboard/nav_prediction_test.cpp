#include <gtest/gtest.h>

#include <algorithm>

#include "tests/onboard/nav_inputs.hpp"

namespace fathom::onboard {
namespace {

using namespace testing;

// How far the predictions were off the final poses.
struct Predictions {
  std::size_t predicted = 0, waited = 0;  // pairs
  double metres = 0, radians = 0;         // worst
};
Predictions predictions(NavCore& core, const std::vector<Input>& inputs) {
  Predictions found;
  std::vector<StereoTrigger> waiting;
  for (const Input& input : inputs) {
    give(core, input);
    const auto* exposure = std::get_if<Exposure>(&input);
    while (const auto trigger = core.pollTrigger()) {
      if (trigger->pose == StereoTrigger::Pose::kFinal) {
        ++found.waited;
      } else if (trigger->pose == StereoTrigger::Pose::kPredicted) {
        // By the very frame that completed it.
        EXPECT_TRUE(exposure != nullptr && exposure->frame_id == trigger->right_frame_id);
        waiting.push_back(*trigger);
      } else if (waiting.empty() || waiting.front().pair_index != trigger->pair_index) {
        ADD_FAILURE() << "pair " << trigger->pair_index << " was not predicted";
      } else {
        const SE3 off = waiting.front().T_odom_body.inverse() * trigger->T_odom_body;
        waiting.erase(waiting.begin());
        ++found.predicted;
        found.metres = std::max(found.metres, off.translation().norm());
        found.radians = std::max(found.radians, Eigen::AngleAxisd(off.rotation()).angle());
      }
    }
  }
  return found;
}

TEST(NavCore, GivesAPairAtOnceWhereItProbablyIsAndAgainForGood) {
  NavCore core(coreConfig());
  const Predictions found = predictions(core, diveInputs(60));
  EXPECT_GE(found.predicted, 117u);
  EXPECT_LE(found.waited, 1u);
  EXPECT_LT(found.metres, 0.0016);
  EXPECT_LT(found.radians, 0.0006);
}

TEST(NavCore, PredictsBeyondADepthThatComesSlowly) {
  NavCore core(coreConfig());
  const Predictions found = predictions(core, diveInputs(60, {5, 10, 0.5}));
  EXPECT_GE(found.predicted, 111u);
  EXPECT_LT(found.metres, 0.07);
}

TEST(NavCore, WhereNothingIsKnownAPairWaitsForItsPose) {
  NavCore core(coreConfig());
  const auto inputs = withoutBottom(60, 10, 40);
  // From a second after the bottom was lost until the track coasts; then predicted again.
  const Predictions found = predictions(core, inputs);
  EXPECT_GE(found.waited, 2u);
  EXPECT_LE(found.waited, 4u);
  EXPECT_GE(found.predicted, 114u);
}

}  // namespace
}  // namespace fathom::onboard
