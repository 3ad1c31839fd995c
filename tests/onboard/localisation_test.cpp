#include <gtest/gtest.h>

#include "tests/onboard/made_dive.hpp"

namespace fathom::onboard {
namespace {

using testing::DiveFaults;
using testing::localised;
using testing::MadeDive;
using testing::makeDive;
using testing::MemorySlots;
using testing::planError;
using testing::smallLocalisation;

MemorySlots featureSlots(std::size_t slots) {
  return {slots, closure::slotBytes(closure::DescriptorKind::kRootSift,
                                    static_cast<std::size_t>(smallLocalisation().features))};
}

std::vector<SE3> reckoned(const MadeDive& dive) {
  std::vector<SE3> poses;
  for (const MadeDive::Frame& f : dive.frames) poses.push_back(f.input.T_odom_cam);
  return poses;
}

TEST(LocalisationCore, ClosuresTakeMostOfDeadReckoningsErrorOutOfADive) {
  const MadeDive dive = makeDive();
  MemorySlots slots = featureSlots(300);
  LocalisationCore core(dive.rig, smallLocalisation(), &slots);
  const std::vector<SE3> poses = localised(core, dive);
  const double before = planError(dive, reckoned(dive)).rms;
  EXPECT_GT(before, 0.1);
  EXPECT_LT(planError(dive, poses).rms, before / 10);
  EXPECT_LT(planError(dive, poses).absolute, 0.4);
  EXPECT_GT(core.graph().counters().closures, 1u);
  EXPECT_EQ(core.closures().counters().waiting, 0u);
  EXPECT_LT(core.keyframes(), static_cast<int>(dive.frames.size()));
}

TEST(LocalisationCore, TheSameDiveGivesTheSamePosesBitForBit) {
  const MadeDive dive = makeDive();
  std::vector<std::vector<SE3>> runs;
  for (int run = 0; run < 2; ++run) {
    MemorySlots slots = featureSlots(300);
    LocalisationCore core(dive.rig, smallLocalisation(), &slots);
    runs.push_back(localised(core, dive));
  }
  for (std::size_t k = 0; k < runs[0].size(); ++k) {
    EXPECT_EQ(runs[0][k].translation(), runs[1][k].translation());
    EXPECT_EQ(runs[0][k].rotation().coeffs(), runs[1][k].rotation().coeffs());
  }
}

TEST(LocalisationCore, SurvivesADvlThatDiesACompassThatJumpsAndWildFixes) {
  DiveFaults faults;
  faults.dvl_dead_from = 15;
  faults.dvl_dead_to = 30;
  faults.compass_jumps_at = 40;
  faults.wild_share = 0.1;
  const MadeDive dive = makeDive(faults);
  MemorySlots slots = featureSlots(300);
  LocalisationCore core(dive.rig, smallLocalisation(), &slots);
  const std::vector<SE3> poses = localised(core, dive);
  EXPECT_GT(planError(dive, reckoned(dive)).rms, 1.0);
  EXPECT_LT(planError(dive, poses).rms, 0.1);
  EXPECT_LT(planError(dive, poses).absolute, 0.6);
  EXPECT_GE(core.graph().counters().compass_jumps, 1u);
  EXPECT_GT(core.graph().counters().dvl_absent, 5u);
}

TEST(LocalisationCore, ADvlThatLiesIsContradictedByTheImagesAndNoticed) {
  DiveFaults faults;
  faults.dvl_lies_from = 15;
  faults.dvl_lies_to = 25;
  const MadeDive dive = makeDive(faults);
  MemorySlots slots = featureSlots(300);
  LocalisationCore core(dive.rig, smallLocalisation(), &slots);
  const std::vector<SE3> poses = localised(core, dive);
  EXPECT_GT(planError(dive, reckoned(dive)).rms, 0.5);
  EXPECT_LT(planError(dive, poses).rms, 0.1);
  EXPECT_GT(core.graph().counters().steps_contradicted, 5u);
  EXPECT_GT(core.counters().odometry_surprises, 0u);
}

TEST(LocalisationCore, LostForSecondsAClosureEntersOnlyWhenAnotherAgreesAndTheWayIsFoundAgain) {
  DiveFaults faults;  // on the second line, blind and without bottom track for two metres
  faults.dvl_dead_from = faults.blind_from = 26;
  faults.dvl_dead_to = faults.blind_to = 30;
  MadeDive dive = makeDive(faults);
  dive.fixes.clear();
  MemorySlots slots = featureSlots(300);
  LocalisationConfig config = smallLocalisation();
  config.predictions_per_keyframe = 200;
  LocalisationCore core(dive.rig, config, &slots);
  const std::vector<SE3> poses = localised(core, dive);
  EXPECT_GT(planError(dive, reckoned(dive)).rms, 0.8);
  EXPECT_GE(core.closures().counters().confirmed, 2u);
  EXPECT_LT(planError(dive, poses).rms, 0.15);
}

TEST(LocalisationCore, ABadDiskCostsClosuresOnly) {
  const MadeDive dive = makeDive();
  MemorySlots slots = featureSlots(300);
  slots.fails = true;
  LocalisationCore core(dive.rig, smallLocalisation(), &slots);
  const std::vector<SE3> poses = localised(core, dive);
  EXPECT_EQ(core.features().counters().stored, 0u);
  EXPECT_EQ(core.features().counters().write_failures, static_cast<std::uint64_t>(core.keyframes()));
  EXPECT_LT(planError(dive, poses).rms, planError(dive, reckoned(dive)).rms);
}

TEST(LocalisationCore, WithRoomForAThirdOfItsKeyframesADiveGoesOnToItsEnd) {
  const MadeDive dive = makeDive();
  MemorySlots slots = featureSlots(300);
  LocalisationCore roomy(dive.rig, smallLocalisation(), &slots);
  const double best = planError(dive, localised(roomy, dive)).rms;
  LocalisationConfig config = smallLocalisation();
  config.max_keyframes = roomy.keyframes() / 3;
  MemorySlots few = featureSlots(static_cast<std::size_t>(config.max_keyframes));
  LocalisationCore core(dive.rig, config, &few);
  const std::vector<SE3> poses = localised(core, dive);
  EXPECT_EQ(core.keyframes(), roomy.keyframes());
  EXPECT_EQ(core.graph().counters().keyframes_refused, 0u);
  EXPECT_GT(core.graph().counters().keyframes_retired, static_cast<std::uint64_t>(core.keyframes() / 2));
  EXPECT_EQ(core.features().counters().given_way, 0u);
  EXPECT_GE(core.graph().counters().closures, 1u);
  EXPECT_LT(planError(dive, poses).rms, 1.2 * best);
  EXPECT_LT(planError(dive, poses).absolute, 0.4);
}

TEST(LocalisationCore, WhatHungOnAKeyframeThatRetiresStaysWhereItIs) {
  const MadeDive dive = makeDive();
  LocalisationConfig config = smallLocalisation();
  config.max_keyframes = 30;
  MemorySlots slots = featureSlots(30);
  LocalisationCore core(dive.rig, config, &slots);
  const SE3 camera(Eigen::Quaterniond::Identity(), {3, 1, 20});
  int retired = 0;
  double jump = 0;
  std::vector<std::pair<int, SE3>> known;  // poses before the frame
  core.setRetiredObserver([&](const slam::NavigationGraph::Retired& gone) {
    ++retired;
    for (const auto& [keyframe, pose] : known)
      if (keyframe == gone.keyframe)
        jump = std::max(
            jump, (core.poseOf(gone.onto, gone.T_onto * camera).translation() - pose.translation()).norm());
  });
  for (const MadeDive::Frame& frame : dive.frames) {
    known.clear();
    for (const int k : core.graph().living()) known.emplace_back(k, core.poseOf(k, camera));
    LocalisationInput input = frame.input;
    input.features = &frame.features;
    (void)core.process(input);
  }
  EXPECT_GT(retired, 50);
  EXPECT_LT(jump, 1e-9);
}

}  // namespace
}  // namespace fathom::onboard
