#include <gtest/gtest.h>

#include "realtime/base/bytes/state_archive.hpp"
#include "tests/onboard/synthetic_survey.hpp"

namespace fathom::onboard {
namespace {

using testing::featureSlots, testing::MemorySlots, testing::planError, testing::smallLocalisation;
using testing::SyntheticSurvey, testing::syntheticSurvey;

std::vector<SE3> reckoned(const SyntheticSurvey& dive) {
  std::vector<SE3> poses;
  for (const SyntheticSurvey::Frame& f : dive.frames) poses.push_back(f.input.T_odom_cam);
  return poses;
}

// A dive through a localisation of its own, from its first pair to its end.
struct Localised {
  explicit Localised(SyntheticSurvey made, const LocalisationConfig& config = smallLocalisation(),
                     MemorySlots its_slots = featureSlots(300))
      : dive(std::move(made)), slots(std::move(its_slots)), core(dive.rigs, config, &slots) {}
  explicit Localised(const testing::DiveFaults& faults = {}) : Localised(syntheticSurvey(faults)) {}
  [[nodiscard]] double before() const { return planError(dive, reckoned(dive)).rms; }
  [[nodiscard]] double rms() const { return planError(dive, poses).rms; }
  [[nodiscard]] double absolute() const { return planError(dive, poses).absolute; }

  SyntheticSurvey dive;
  MemorySlots slots;
  LocalisationCore core;
  std::vector<SE3> poses = testing::localised(core, dive);
};

TEST(LocalisationCore, ClosuresTakeMostOfDeadReckoningsErrorOutOfADive) {
  const Localised run;
  EXPECT_GT(run.before(), 0.1);
  EXPECT_LT(run.rms(), run.before() / 10);
  EXPECT_LT(run.absolute(), 0.4);
  EXPECT_GT(run.core.graph().counters().closures, 1u);
  EXPECT_EQ(run.core.closures().counters().waiting, 0u);
  EXPECT_LT(run.core.keyframes(), static_cast<int>(run.dive.frames.size()));
}

TEST(LocalisationCore, ClaimsOfThePresentPlaceGrowByDeadReckoningSinceTheNewestKeyframeOnly) {
  const Localised run;
  const LocalisationCore& core = run.core;
  const int newest = core.keyframes() - 1;
  const std::int64_t then = core.graph().utcNs(newest);
  const SE3 here = core.graph().odometry(newest);
  const auto& last = run.dive.frames.back().input.quality;
  EXPECT_NEAR(core.positionSigma(then, here, last), core.positionSigma(), 1e-4);
  const SE3 metre_on(here.rotation(), here.translation() + Eigen::Vector3d(1, 0, 0));
  const std::int64_t later = then + 2'000'000'000;
  const double after = core.positionSigma(later, metre_on, last);
  const slam::SensorNoise noise;
  const double wander = slam::wanderSigma(1, 2, noise);
  EXPECT_GT(after, std::hypot(core.positionSigma(), wander));
  EXPECT_LT(after, std::hypot(core.positionSigma(), 1.2 * wander));
  auto unlocked = last;
  unlocked.unlocked_s += 10;
  EXPECT_GT(core.positionSigma(then + 10'000'000'000, here, unlocked), 9 * noise.unknown_velocity);
}

TEST(LocalisationCore, TheSameDiveGivesTheSamePosesBitForBit) {
  const Localised one, again;
  for (std::size_t k = 0; k < one.poses.size(); ++k) {
    EXPECT_EQ(one.poses[k].translation(), again.poses[k].translation());
    EXPECT_EQ(one.poses[k].rotation().coeffs(), again.poses[k].rotation().coeffs());
  }
}

TEST(LocalisationCore, SurvivesADvlThatDiesACompassThatJumpsAndWildFixes) {
  const Localised run({.dvl_dead_from = 15, .dvl_dead_to = 30, .compass_jumps_at = 40, .wild_share = 0.1});
  EXPECT_GT(run.before(), 1.0);
  EXPECT_LT(run.rms(), 0.1);
  EXPECT_LT(run.absolute(), 0.6);
  EXPECT_GE(run.core.graph().counters().compass_jumps, 1u);
  EXPECT_GT(run.core.graph().counters().dvl_absent, 5u);
}

TEST(LocalisationCore, ACompassThatStepsWhileTheDvlIsSilentIsDistinguishedFromAnOutlierLinkByThePairBefore) {
  const Localised run({.dvl_dead_from = 15, .dvl_dead_to = 21, .compass_steps_at = 20});
  EXPECT_LT(run.rms(), 0.1);
  EXPECT_EQ(run.core.graph().counters().visual_rejected, 0u);
  EXPECT_EQ(run.core.graph().counters().compass_jumps, 1u);
}

TEST(LocalisationCore, AnOutlyingDvlIsContradictedByTheImagesAndDetected) {
  const Localised run({.dvl_wrong_from = 15, .dvl_wrong_to = 25});
  EXPECT_GT(run.before(), 0.5);
  EXPECT_LT(run.rms(), 0.1);
  EXPECT_GT(run.core.graph().counters().steps_contradicted, 5u);
  EXPECT_GT(run.core.counters().odometry_surprises, 0u);
}

// By its velocity keyframes would come so seldom that they share too little of the seafloor.
TEST(LocalisationCore, WhereADvlIsStuckEveryPairIsAKeyframeFromTheFirstStepThatContradictsIt) {
  const Localised run({.dvl_stuck_from = 16, .dvl_stuck_to = 26});
  EXPECT_LT(run.rms(), 0.03);
  EXPECT_LE(run.core.counters().odometry_second_tries, 1u);
}

TEST(LocalisationCore, LostForSecondsAClosureEntersOnlyWhenAnotherAgreesAndThePositionIsRecovered) {
  // On the second line, blind and without bottom track for four metres: beyond what the velocity before
  // bridges.
  SyntheticSurvey dive =
      syntheticSurvey({.dvl_dead_from = 26, .dvl_dead_to = 34, .blind_from = 26, .blind_to = 34});
  dive.fixes.clear();
  LocalisationConfig config = smallLocalisation();
  config.predictions_per_keyframe = 200;
  const Localised run(std::move(dive), config);
  EXPECT_GT(run.before(), 0.8);
  EXPECT_GE(run.core.closures().counters().confirmed, 2u);
  EXPECT_LT(run.rms(), 0.15);
}

// Blind and without bottom track on the outward track, until it is 10 m and 100 degrees astray.
testing::DiveFaults lost(double to) {
  return {.blind_from = 22, .blind_to = to, .astray_from = 22, .astray_to = to};
}

// How far the camera is from where it truly is, seen from the first frame.
struct Astray {
  double metres = 0, radians = 0;
};
Astray astray(const LocalisationCore& core, const SyntheticSurvey& dive, int keyframe, std::size_t frame) {
  const SE3 found = core.poseOf(0, dive.frames[0].input.T_odom_cam).inverse() *
                    core.poseOf(keyframe, dive.frames[frame].input.T_odom_cam);
  const SE3 error = (dive.frames[0].truth.inverse() * dive.frames[frame].truth).inverse() * found;
  return {error.translation().norm(), error.rotation().angularDistance(Eigen::Quaterniond::Identity())};
}

TEST(LocalisationCore, LostByTenMetresAndAHundredDegreesItIsFoundWithinTenPairsOfACrossing) {
  constexpr std::size_t kFirstLine = 32;  // frames
  const double shares = closure::separationOfOverlap(0.1);
  for (const std::uint32_t seed : {1U, 2U, 3U}) {
    SyntheticSurvey dive = syntheticSurvey(lost(50), seed, testing::DiveTrack::kCrossing);
    MemorySlots slots = featureSlots(300);
    LocalisationCore core(dive.rigs, smallLocalisation(), &slots);
    int overlapping = 0, found_after = -1;
    Astray worst, last;
    for (std::size_t k = 0; k < dive.frames.size(); ++k) {
      last = astray(core, dive, dive.frames[k].placeIn(core), k);
      worst = {std::max(worst.metres, last.metres), std::max(worst.radians, last.radians)};
      const Eigen::Vector2d here = dive.frames[k].truth.translation().head<2>();
      const double radius = core.closures().footprint(0).radius;
      bool overlaps = overlapping > 0;
      for (std::size_t j = 0; j < kFirstLine && k > 3 * kFirstLine; ++j)
        overlaps = overlaps || (dive.frames[j].truth.translation().head<2>() - here).norm() < shares * radius;
      overlapping += overlaps ? 1 : 0;  // and those after
      if (overlapping > 0 && found_after < 0 && last.metres < 0.3 && last.radians < 0.1)
        found_after = overlapping;
    }
    EXPECT_GT(worst.metres, 10.0);
    EXPECT_GT(worst.radians, 1.7);
    EXPECT_GT(found_after, 0) << seed;
    EXPECT_LE(found_after, 10) << seed;
    EXPECT_GE(core.closures().counters().recognised, 3u);
    core.finish();
    for (const Closure& c : core.closures().closures()) EXPECT_GE(c.inliers, 15);
    EXPECT_LT(last.metres, 0.3) << seed;
  }
}

TEST(LocalisationCore, SavedWhileClaimsWaitItIsFoundAgainAfterLoading) {
  const SyntheticSurvey dive = syntheticSurvey(lost(50), 1, testing::DiveTrack::kCrossing);
  MemorySlots slots = featureSlots(300);
  LocalisationCore core(dive.rigs, smallLocalisation(), &slots),
      again(dive.rigs, smallLocalisation(), &slots);
  std::vector<std::uint8_t> bytes(std::size_t{64} << 20);
  constexpr std::size_t kSavedAt = 145;  // the first claims wait
  for (std::size_t k = 0; k < dive.frames.size(); ++k) {
    dive.frames[k].placeIn(core);
    if (k > kSavedAt) dive.frames[k].placeIn(again);
    if (k != kSavedAt) continue;
    EXPECT_GT(core.closures().counters().unconfirmed_now, 0u);
    rt::StateWriter writer(bytes);
    core.save(writer);
    ASSERT_FALSE(writer.full());
    rt::StateReader reader(writer.written());
    ASSERT_TRUE(again.load(reader));
  }
  EXPECT_GE(again.closures().counters().recognised, 3u);
  const std::size_t last = dive.frames.size() - 1;
  EXPECT_LT(astray(again, dive, again.keyframes() - 1, last).metres, 0.3);
}

TEST(LocalisationCore, LostOverOtherGroundThatLooksAlikeNothingIsClosed) {
  for (const std::uint32_t seed : {1U, 2U, 3U}) {
    const Localised run(syntheticSurvey(lost(100), seed, testing::DiveTrack::kElsewhere));
    EXPECT_EQ(run.core.graph().counters().closures, 0u);
    EXPECT_GT(run.core.closures().counters().places_tried, 40u);
    EXPECT_EQ(run.core.closures().counters().places_accepted, 0u);
  }
}

TEST(LocalisationCore, ABadDiskCostsClosuresOnly) {
  MemorySlots bad = featureSlots(300);
  bad.fails = true;
  const Localised run(syntheticSurvey(), smallLocalisation(), bad);
  EXPECT_EQ(run.core.features().counters().stored, 0u);
  EXPECT_EQ(run.core.features().counters().write_failures, static_cast<std::uint64_t>(run.core.keyframes()));
  EXPECT_LT(run.rms(), run.before());
}

TEST(LocalisationCore, WithRoomForAThirdOfItsKeyframesADiveContinuesToItsEnd) {
  const Localised roomy;
  LocalisationConfig config = smallLocalisation();
  config.max_keyframes = roomy.core.keyframes() / 3;
  const Localised run(syntheticSurvey(), config,
                      featureSlots(static_cast<std::size_t>(config.max_keyframes)));
  const LocalisationCore& core = run.core;
  EXPECT_EQ(core.keyframes(), roomy.core.keyframes());
  EXPECT_EQ(core.graph().counters().keyframes_refused, 0u);
  EXPECT_GT(core.graph().counters().keyframes_retired, static_cast<std::uint64_t>(core.keyframes() / 2));
  EXPECT_EQ(core.features().counters().evicted, 0u);
  EXPECT_GE(core.closures().counters().accepted, 1u);  // where it has been before is recognised
  EXPECT_LT(run.rms(), 1.6 * roomy.rms());
  EXPECT_LT(run.absolute(), 0.4);
}

TEST(LocalisationCore, WhatHungOnAKeyframeThatRetiresStaysWhereItIs) {
  const SyntheticSurvey dive = syntheticSurvey();
  LocalisationConfig config = smallLocalisation();
  config.max_keyframes = 30;
  MemorySlots slots = featureSlots(30);
  LocalisationCore core(dive.rigs, config, &slots);
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
  for (const SyntheticSurvey::Frame& frame : dive.frames) {
    known.clear();
    for (const int k : core.graph().living()) known.emplace_back(k, core.poseOf(k, camera));
    frame.placeIn(core);
  }
  EXPECT_GT(retired, 50);
  EXPECT_LT(jump, 1e-9);
}

}  // namespace
}  // namespace fathom::onboard
