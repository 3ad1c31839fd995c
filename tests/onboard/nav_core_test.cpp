#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string_view>

#include "tests/onboard/nav_inputs.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/saved_state.hpp"

namespace fathom::onboard {
namespace {

using namespace testing;
using fathom::test::savedState;

std::uint64_t counter(const NavCore& core, std::string_view name) {
  for (const NavHealth::Counter& c : core.health().counters)
    if (c.name == name) return c.value;
  ADD_FAILURE() << "no counter " << name;
  return 0;
}

TEST(NavCore, GivesEveryPairItsPoseAndAltitude) {
  NavCore core(coreConfig());
  const auto triggers = run(core, diveInputs(60));
  ASSERT_GE(triggers.size(), 118u);
  for (std::uint32_t i = 0; i < triggers.size(); ++i) {
    const StereoTrigger& trigger = triggers[i];
    EXPECT_EQ(trigger.pair_index, i);
    EXPECT_EQ(trigger.utc_ns, at(pairTime(i)));
    EXPECT_EQ(trigger.left_frame_id, 2 * i);
    EXPECT_EQ(trigger.right_frame_id, 2 * i + 1);
    EXPECT_LT(positionError(trigger.T_odom_body, circle, pairTime(i)), 0.005);
    EXPECT_TRUE(trigger.altitude_valid);
    EXPECT_NEAR(trigger.altitude, 2.0 * 1530 / 1500, 1e-9);
  }
}

TEST(NavCore, EveryPairHasItsDepthAlsoFromASensorThatSpeaksEveryTwoSeconds) {
  NavCore core(coreConfig());
  const auto triggers = run(core, diveInputs(60, {5, 10, 0.5}));
  ASSERT_GE(triggers.size(), 115u);
  for (const StereoTrigger& trigger : triggers)
    EXPECT_FALSE(trigger.quality.depth_held) << trigger.pair_index;
}

TEST(NavCore, EveryPairHasTheGyrosTurnAtItsOwnTime) {
  NavCore core(coreConfig());
  const auto triggers = run(core, diveInputs(60, {1, 10, 5, 10}));
  ASSERT_GE(triggers.size(), 115u);
  double worst = 0;
  for (std::size_t i = 1; i < triggers.size(); ++i) {
    const nav::DeadReckoning::Quality &a = triggers[i - 1].quality, &b = triggers[i].quality;
    const double seconds = static_cast<double>(triggers[i].utc_ns - triggers[i - 1].utc_ns) * 1e-9;
    EXPECT_TRUE(b.has_gyro);
    EXPECT_EQ(b.ungyro_s, a.ungyro_s);
    worst = std::max(worst, std::abs(b.gyro_turn - a.gyro_turn - 0.1 * seconds));  // 0.1 rad/s of heading
  }
  EXPECT_LT(worst, 2e-4);
}

TEST(NavCore, GivesATriggerOnlyOnceTheOdometryCoversItsTime) {
  NavCore core(coreConfig());
  for (const Input& input : diveInputs(20)) {
    give(core, input);
    while (const auto trigger = core.pollTrigger())
      EXPECT_EQ(trigger->utc_ns > core.odometry().newestUtcNs(),
                trigger->pose == StereoTrigger::Pose::kPredicted);
  }
}

TEST(NavCore, TwoRunsOfTheSameInputsAgreeBitForBit) {
  NavCore a(coreConfig()), b(coreConfig());
  const auto inputs = diveInputs(30);
  const auto first = run(a, inputs), second = run(b, inputs);
  ASSERT_EQ(first.size(), second.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].T_odom_body.translation(), second[i].T_odom_body.translation());
    EXPECT_EQ(first[i].T_odom_body.rotation().coeffs(), second[i].T_odom_body.rotation().coeffs());
    EXPECT_EQ(first[i].altitude, second[i].altitude);
  }
}

TEST(NavCore, GoesOnFromASavedStateBitForBit) {
  const auto inputs = diveInputs(60, {5, 10, 5, 10});
  for (const double stop : {0.0, 0.1, 3.3, 31.0, 59.0}) {
    NavCore whole(coreConfig());
    const auto middle = static_cast<std::ptrdiff_t>(static_cast<double>(inputs.size()) * stop / 60);
    (void)run(whole, {inputs.begin(), inputs.begin() + middle});
    const std::vector<std::uint8_t> state = savedState(whole);
    NavCore loaded(coreConfig());
    (void)run(loaded, {inputs.begin(), inputs.begin() + 500});  // what it knew before is forgotten
    rt::StateReader reader(state);
    ASSERT_TRUE(loaded.load(reader)) << reader.failure();
    EXPECT_EQ(savedState(loaded), state);
    const std::vector<Input> rest(inputs.begin() + middle, inputs.end());
    EXPECT_EQ(run(whole, rest).size(), run(loaded, rest).size());
    EXPECT_EQ(savedState(whole), savedState(loaded));
    for (std::size_t i = 0; i < NavHealth::kCounters; ++i) {
      EXPECT_EQ(loaded.health().counters[i].name, whole.health().counters[i].name);
      EXPECT_EQ(loaded.health().counters[i].value, whole.health().counters[i].value);
    }
  }
}

TEST(NavCore, SurvivesASavedStateThatIsDamaged) {
  const auto inputs = diveInputs(20);
  NavCore core(coreConfig());
  (void)run(core, inputs);
  const std::vector<std::uint8_t> state = savedState(core);
  const std::size_t head = sizeof(rt::StateSectionHead);
  int refused = 0;
  for (std::size_t at = 0; at < state.size(); at += 97) {
    std::vector<std::uint8_t> damaged = state;
    damaged[at] ^= 0x80;
    NavCore other(coreConfig());
    rt::StateReader reader(damaged);
    EXPECT_EQ(other.load(reader), at >= head - 4 && at < head) << at;
    if (at < head) continue;
    // The same with the right checksum: refused, or of no harm.
    rt::StateSectionHead good;
    std::memcpy(&good, damaged.data(), head);
    good.crc = crc32(std::span(damaged).subspan(head));
    std::memcpy(damaged.data(), &good, head);
    rt::StateReader again(damaged);
    if (other.load(again))
      (void)run(other, inputs);
    else
      ++refused;
  }
  EXPECT_GT(refused, 0);
}

TEST(NavCore, StepsWithoutHeapCallsOrPageFaults) {
  const auto inputs = diveInputs(120);
  NavCore core(coreConfig());
  // The first seconds touch the code and the stack once.
  const std::size_t warm = inputs.size() / 10;
  std::uint64_t triggers = 0;
  const fathom::test::ThreadCost armed = fathom::test::threadCost();
  for (std::size_t i = 0; i < warm; ++i) {
    give(core, inputs[i]);
    while (core.pollTrigger()) ++triggers;
  }
  const fathom::test::ThreadCost steady = fathom::test::threadCost();
  for (std::size_t i = warm; i < inputs.size(); ++i) {
    give(core, inputs[i]);
    while (core.pollTrigger()) ++triggers;
  }
  const fathom::test::ThreadCost end = fathom::test::threadCost();
  EXPECT_GT(triggers, 200u);
  EXPECT_EQ((end - armed).heap_calls, 0u);
  if (!fathom::test::sanitized()) {
    EXPECT_EQ((end - steady).minor_faults + (end - steady).major_faults, 0u);
  }
}

TEST(NavCore, WithoutNavigationDropsTheOldestPairsAndCountsThem) {
  NavCore core(coreConfig());
  const auto inputs = withoutBottom(60, -1, 60);
  EXPECT_TRUE(run(core, inputs).empty());
  const NavHealth& health = core.health();
  EXPECT_FALSE(health.initialised);
  EXPECT_EQ(health.odometry_age, -1);
  EXPECT_EQ(health.dvl_age, -1);
  EXPECT_EQ(health.waiting_pairs, 32u);
  EXPECT_EQ(counter(core, "pairs_uncovered") + 32, counter(core, "pairs"));
}

TEST(NavCore, PairsFromBeforeTheOdometryAreDroppedAndLaterOnesKeepTheirNumbers) {
  NavCore core(coreConfig());
  const auto inputs = withoutBottom(20, -1, 5);
  const auto triggers = run(core, inputs);
  ASSERT_FALSE(triggers.empty());
  EXPECT_EQ(triggers.front().pair_index, 10u);
  EXPECT_EQ(triggers.front().utc_ns, at(pairTime(10)));
  EXPECT_EQ(counter(core, "pairs_uncovered"), 10u);
}

TEST(NavCore, ALongLossOfBottomTrackDoesNotStopTheTriggers) {
  NavCore core(coreConfig());
  const auto inputs = withoutBottom(60, 10, 40);
  const auto triggers = run(core, inputs);
  EXPECT_GE(triggers.size(), 118u);
  bool without_altitude = false;
  for (const StereoTrigger& trigger : triggers)
    if (trigger.utc_ns > at(15) && trigger.utc_ns < at(35)) {
      EXPECT_FALSE(trigger.altitude_valid);
      without_altitude = true;
    }
  EXPECT_TRUE(without_altitude);
  EXPECT_EQ(counter(core, "dvl_coasted"), 1u);
}

TEST(NavCore, TriggersThatNobodyTakesAreDroppedOldestFirst) {
  NavCore core(coreConfig());
  for (const Input& input : diveInputs(60)) give(core, input);
  core.tick(at(60));
  const auto oldest = core.pollTrigger();
  ASSERT_TRUE(oldest);
  EXPECT_EQ(oldest->pair_index + 32, counter(core, "triggers"));
  EXPECT_EQ(counter(core, "triggers_dropped") + 64,
            counter(core, "triggers") + counter(core, "pairs_predicted"));
}

TEST(NavCore, AppliesTheSensorsTimeOffsets) {
  NavCoreConfig late = coreConfig();
  late.time_offsets = {0.1, -0.2, 0.3, -0.4, 0.5};
  NavCore shifted(late), plain(coreConfig());
  const auto offset = [](const Input& input) {
    if (const auto* frame = std::get_if<Exposure>(&input))
      return frame->side == CameraSide::kLeft ? 0.1 : -0.2;
    if (isDvl(input)) return 0.3;
    if (std::holds_alternative<AttitudeSample>(input)) return -0.4;
    return std::holds_alternative<DepthSample>(input) ? 0.5 : 0.0;
  };
  auto inputs = diveInputs(20);
  const auto expected = run(plain, inputs);
  for (Input& input : inputs)
    std::visit([ns = std::llround(offset(input) * 1e9)](auto& i) { i.utc_ns -= ns; }, input);
  const auto got = run(shifted, inputs);
  ASSERT_EQ(got.size(), expected.size());
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(got[i].utc_ns, expected[i].utc_ns);
    EXPECT_EQ(got[i].T_odom_body.translation(), expected[i].T_odom_body.translation());
  }
}

TEST(NavCore, HealthHasAgesSpeedAndCounters) {
  NavCore core(coreConfig());
  EXPECT_EQ(core.health().utc_ns, 0);
  run(core, diveInputs(30));
  core.tick(at(32));
  const NavHealth& health = core.health();
  EXPECT_EQ(health.utc_ns, at(32));
  EXPECT_TRUE(health.initialised);
  EXPECT_NEAR(health.attitude_age, 2.1, 1e-6);
  EXPECT_NEAR(health.dvl_age, 2.163, 1e-6);
  EXPECT_NEAR(health.depth_age, 2.187, 1e-6);
  EXPECT_NEAR(health.left_age, 2.25, 1e-6);
  EXPECT_NEAR(health.right_age, 2.246, 1e-6);
  EXPECT_EQ(health.water_age, -1);
  // The last ensemble (29.837 s) waits for a depth sample after the last one (29.813 s), and pair 59 for it.
  EXPECT_NEAR(health.odometry_age, 2.363, 1e-6);
  EXPECT_EQ(health.waiting_pairs, 1u);
  EXPECT_NEAR(health.speed, 1.0, 0.05);
  EXPECT_NEAR(health.depth, circle(29.637).translation().z(), 0.005);
  EXPECT_EQ(counter(core, "pairs"), 60u);
  EXPECT_EQ(counter(core, "triggers"), 59u);
  EXPECT_EQ(counter(core, "left_unpaired"), 0u);
  EXPECT_EQ(counter(core, "dvl_used"), 149u);
  for (const NavHealth::Counter& c : health.counters) EXPECT_FALSE(c.name.empty());
}

TEST(NavCore, HealthTicksAtAnyTimeNeverMakeAnAgeNegative) {
  NavCore core(coreConfig());
  run(core, diveInputs(3));
  core.tick(std::numeric_limits<std::int64_t>::min());
  EXPECT_EQ(core.health().dvl_age, 0);
  core.tick(std::numeric_limits<std::int64_t>::max());
  EXPECT_GT(core.health().dvl_age, 0);
}

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
