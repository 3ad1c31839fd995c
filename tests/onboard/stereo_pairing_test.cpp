#include "realtime/base/units.hpp"
#include "realtime/onboard/nav/nav_core.hpp"

#include <gtest/gtest.h>

#include <deque>
#include <limits>
#include <random>
#include <utility>

namespace fathom::onboard {
namespace {

constexpr std::int64_t kT = 1'700'000'000'000 * kMillisecond_ns;
constexpr auto kLeft = CameraSide::kLeft;
constexpr auto kRight = CameraSide::kRight;

TEST(StereoPairing, PairsAcrossTheToleranceWhicheverCameraComesFirst) {
  StereoPairing pairing(20 * kMillisecond_ns);
  EXPECT_FALSE(pairing.add(kLeft, {kT, 1}));
  const auto first = pairing.add(kRight, {kT + 20 * kMillisecond_ns, 2});
  ASSERT_TRUE(first);
  EXPECT_EQ(first->left.frame_id, 1u);
  EXPECT_EQ(first->right.frame_id, 2u);
  EXPECT_FALSE(pairing.add(kRight, {kT + 500 * kMillisecond_ns, 3}));
  const auto second = pairing.add(kLeft, {kT + 515 * kMillisecond_ns, 4});
  ASSERT_TRUE(second);
  EXPECT_EQ(second->left.frame_id, 4u);
  EXPECT_EQ(second->right.frame_id, 3u);
  EXPECT_EQ(pairing.unpaired(kLeft) + pairing.unpaired(kRight), 0u);
}

TEST(StereoPairing, GivesUpFramesWithoutPartner) {
  StereoPairing pairing(20 * kMillisecond_ns);
  for (int i = 0; i < 10; ++i) {
    const std::int64_t t = kT + i * 500 * kMillisecond_ns;
    EXPECT_FALSE(pairing.add(kLeft, {t, static_cast<std::uint32_t>(i)}));
    if (i % 3 == 1) continue;  // the right camera loses every third frame
    const auto pair = pairing.add(kRight, {t + 3 * kMillisecond_ns, static_cast<std::uint32_t>(100 + i)});
    ASSERT_TRUE(pair);
    EXPECT_EQ(pair->left.frame_id + 100, pair->right.frame_id);
  }
  EXPECT_EQ(pairing.unpaired(kLeft), 3u);
  EXPECT_EQ(pairing.unpaired(kRight), 0u);
}

TEST(StereoPairing, BeyondTheToleranceIsNoPair) {
  StereoPairing pairing(20 * kMillisecond_ns);
  EXPECT_FALSE(pairing.add(kLeft, {kT, 1}));
  EXPECT_FALSE(pairing.add(kRight, {kT + 20 * kMillisecond_ns + 1, 2}));
  EXPECT_EQ(pairing.unpaired(kLeft), 1u);
}

TEST(StereoPairing, TakesTheNearestOfSeveral) {
  StereoPairing pairing(20 * kMillisecond_ns);
  EXPECT_FALSE(pairing.add(kRight, {kT - 15 * kMillisecond_ns, 1}));
  EXPECT_FALSE(pairing.add(kRight, {kT + 2 * kMillisecond_ns, 2}));
  EXPECT_FALSE(pairing.add(kRight, {kT + 12 * kMillisecond_ns, 3}));
  const auto pair = pairing.add(kLeft, {kT, 9});
  ASSERT_TRUE(pair);
  EXPECT_EQ(pair->right.frame_id, 2u);
  EXPECT_EQ(pairing.unpaired(kRight), 1u);
}

TEST(StereoPairing, FollowsCameraClocksThatDriftApartByHundredsOfMilliseconds) {
  StereoPairing pairing(20 * kMillisecond_ns);
  int pairs = 0;
  constexpr int kFrames = 7200;  // an hour at 2 Hz
  for (int i = 0; i < kFrames; ++i) {
    const std::int64_t t = kT + i * 500 * kMillisecond_ns;
    const std::int64_t drift = (t - kT) / 10'000;  // 100 ppm: 360 ms in the hour
    const auto id = static_cast<std::uint32_t>(i);
    EXPECT_FALSE(pairing.add(kLeft, {t, id}));
    const auto pair = pairing.add(kRight, {t + drift, id});
    if (!pair) continue;
    EXPECT_EQ(pair->left.frame_id, pair->right.frame_id);
    ++pairs;
  }
  EXPECT_EQ(pairs, kFrames);
  EXPECT_NEAR(static_cast<double>(pairing.skewNs()), 360.0 * kMillisecond_ns, 2.0 * kMillisecond_ns);
}

TEST(StereoPairing, FindsCamerasThatDriftedApartInADescentOrWhileTheyWereOff) {
  StereoPairing pairing(20 * kMillisecond_ns, kT);
  int pairs = 0, mismatched = 0;
  std::uint32_t id = 0;
  const auto expose = [&](std::int64_t from_s, int frames) {
    pairs = 0;
    for (int i = 0; i < frames; ++i, ++id) {
      const std::int64_t since = from_s * 1000 * kMillisecond_ns + i * 500 * kMillisecond_ns;
      (void)pairing.add(kLeft, {kT + since, id});
      const auto pair = pairing.add(kRight, {kT + since + since / 10'000, id});  // 100 ppm
      if (!pair) continue;
      mismatched += pair->left.frame_id != pair->right.frame_id;
      ++pairs;
    }
    return pairs;
  };
  // The first gives no period yet, or is taken for a damaged stamp.
  EXPECT_GE(expose(600, 100), 99);         // 60 ms apart
  EXPECT_GE(expose(1500, 100), 99);        // again, after a quarter of an hour: 90 ms more
  EXPECT_GE(expose(2600, 30000), 29'999);  // up to five hours: 1.76 s
  EXPECT_EQ(mismatched, 0);
}

TEST(StereoPairing, OneDeadCameraOverflowsTheWaitAndIsCounted) {
  StereoPairing pairing(20 * kMillisecond_ns);
  for (std::uint32_t i = 0; i < 100; ++i)
    EXPECT_FALSE(pairing.add(kLeft, {kT + i * 500 * kMillisecond_ns, i}));
  EXPECT_EQ(pairing.unpaired(kLeft), 84u);
  // The other camera, come back 16 frames late, still finds its partners.
  EXPECT_TRUE(pairing.add(kRight, {kT + 90 * 500 * kMillisecond_ns, 190}));
}

TEST(StereoPairing, RefusesRepeatedBackwardAndImpossibleTimes) {
  StereoPairing pairing(20 * kMillisecond_ns);
  EXPECT_FALSE(pairing.add(kLeft, {std::numeric_limits<std::int64_t>::min(), 0}));
  EXPECT_FALSE(pairing.add(kLeft, {kT, 1}));
  EXPECT_FALSE(pairing.add(kLeft, {kT, 2}));
  EXPECT_FALSE(pairing.add(kLeft, {kT - 1, 3}));
  EXPECT_FALSE(pairing.add(kLeft, {std::numeric_limits<std::int64_t>::max(), 4}));
  EXPECT_EQ(pairing.refused(), 4u);
  const auto pair = pairing.add(kRight, {kT, 5});
  ASSERT_TRUE(pair);
  EXPECT_EQ(pair->left.frame_id, 1u);
}

TEST(StereoPairing, HoldsItsToleranceWhenACameraExposesLate) {
  StereoPairing pairing(20 * kMillisecond_ns);
  std::uint32_t id = 0;
  std::int64_t t = kT;
  const auto expose = [&](std::int64_t late_ns) {
    t += 500 * kMillisecond_ns;
    EXPECT_FALSE(pairing.add(kLeft, {t, ++id}));
    return pairing.add(kRight, {t + late_ns, id}).has_value();
  };
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(expose(0));
  // A minute of a trigger that is late by less than the tolerance: two clocks do not drift so fast.
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(expose(15 * kMillisecond_ns));
  EXPECT_LT(pairing.skewNs(), 3 * kMillisecond_ns);
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(expose(30 * kMillisecond_ns));
}

// Two cameras as they are at sea: stamps mapped to the vehicle's time with an error of a few milliseconds,
// clocks that drift, frames lost on either side and on both, late exposures, restarts with a new error,
// arrivals out of step. The frame's number stands for the moment of the exposure: a pair of two numbers is a
// mismatch.
TEST(StereoPairing, NeverPairsTwoMomentsWhateverIsLostLateOrStartedAgain) {
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> chance(0, 1);
    std::uniform_int_distribution<std::int64_t> error(-4 * kMillisecond_ns, 4 * kMillisecond_ns),
        jitter(-kMillisecond_ns / 2, kMillisecond_ns / 2);
    const std::int64_t period = seed % 2 == 0 ? 500 * kMillisecond_ns : 100 * kMillisecond_ns;
    StereoPairing pairing(20 * kMillisecond_ns);
    struct Camera {
      std::int64_t offset = 0;
      double ppm = 0;
      int away = 0;  // exposures
    } cameras[2];
    cameras[0].ppm = 60 * chance(random);
    cameras[1].ppm = -60 * chance(random);
    // Frames in transit: one camera's may come some frames after the other's.
    std::deque<std::pair<CameraSide, StereoPairing::Frame>> late_side;
    int paired = 0, pairable = 0, mismatched = 0;
    constexpr int kFrames = 5000;
    for (int i = 0; i < kFrames; ++i) {
      const std::int64_t t = kT + i * period;
      const bool late = chance(random) < 0.02;
      const bool both_lost = chance(random) < 0.02;
      int came = 0;
      for (const CameraSide side : {kLeft, kRight}) {
        Camera& camera = cameras[static_cast<std::size_t>(side)];
        if (camera.away > 0 && --camera.away == 0) camera.offset = error(random);  // mapped again
        if (camera.away == 0 && chance(random) < 0.002)
          camera.away = 1 + static_cast<int>(40 * chance(random));
        if (camera.away > 0 || both_lost || chance(random) < 0.05) continue;
        const bool exposes_late = late && side == kRight;
        const std::int64_t drift = static_cast<std::int64_t>(static_cast<double>(t - kT) * camera.ppm * 1e-6);
        // What the map leaves of a drift: it is read every ten seconds.
        const std::int64_t left_of_drift = drift % (2 * kMillisecond_ns);
        const std::int64_t stamp =
            t + camera.offset + left_of_drift + jitter(random) + (exposes_late ? 50 * kMillisecond_ns : 0);
        late_side.push_back({side, {stamp, static_cast<std::uint32_t>(i)}});
        came += exposes_late ? 0 : 1;
      }
      pairable += came == 2;
      // A backlog of up to six frames, handed over in bursts.
      if (chance(random) < 0.4 && late_side.size() < 12) continue;
      std::stable_partition(late_side.begin(), late_side.end(),
                            [&](const auto& frame) { return (frame.first == kLeft) == (i % 2 == 0); });
      for (; !late_side.empty(); late_side.pop_front())
        if (const auto pair = pairing.add(late_side.front().first, late_side.front().second)) {
          ++paired;
          mismatched += pair->left.frame_id != pair->right.frame_id;
        }
    }
    EXPECT_EQ(mismatched, 0) << "seed " << seed;
    EXPECT_GT(paired, pairable * 95 / 100) << "seed " << seed;
  }
}

}  // namespace
}  // namespace fathom::onboard
