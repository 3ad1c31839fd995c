#include "realtime/onboard/nav/stereo_pairing.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace fathom::onboard {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kT = 1'700'000'000'000 * kMs;
constexpr auto kLeft = CameraSide::kLeft;
constexpr auto kRight = CameraSide::kRight;

TEST(StereoPairing, PairsAcrossTheToleranceWhicheverCameraComesFirst) {
  StereoPairing pairing(20 * kMs);
  EXPECT_FALSE(pairing.add(kLeft, {kT, 1}));
  const auto first = pairing.add(kRight, {kT + 20 * kMs, 2});
  ASSERT_TRUE(first);
  EXPECT_EQ(first->left.frame_id, 1u);
  EXPECT_EQ(first->right.frame_id, 2u);
  EXPECT_FALSE(pairing.add(kRight, {kT + 500 * kMs, 3}));
  const auto second = pairing.add(kLeft, {kT + 515 * kMs, 4});
  ASSERT_TRUE(second);
  EXPECT_EQ(second->left.frame_id, 4u);
  EXPECT_EQ(second->right.frame_id, 3u);
  EXPECT_EQ(pairing.unpaired(kLeft) + pairing.unpaired(kRight), 0u);
}

TEST(StereoPairing, GivesUpFramesWhosePartnerIsMissing) {
  StereoPairing pairing(20 * kMs);
  for (int i = 0; i < 10; ++i) {
    const std::int64_t t = kT + i * 500 * kMs;
    EXPECT_FALSE(pairing.add(kLeft, {t, static_cast<std::uint32_t>(i)}));
    if (i % 3 == 1) continue;  // the right camera loses every third frame
    const auto pair = pairing.add(kRight, {t + 3 * kMs, static_cast<std::uint32_t>(100 + i)});
    ASSERT_TRUE(pair);
    EXPECT_EQ(pair->left.frame_id + 100, pair->right.frame_id);
  }
  EXPECT_EQ(pairing.unpaired(kLeft), 3u);
  EXPECT_EQ(pairing.unpaired(kRight), 0u);
}

TEST(StereoPairing, BeyondTheToleranceIsNoPair) {
  StereoPairing pairing(20 * kMs);
  EXPECT_FALSE(pairing.add(kLeft, {kT, 1}));
  EXPECT_FALSE(pairing.add(kRight, {kT + 20 * kMs + 1, 2}));
  EXPECT_EQ(pairing.unpaired(kLeft), 1u);
}

TEST(StereoPairing, TakesTheNearestOfSeveral) {
  StereoPairing pairing(20 * kMs);
  EXPECT_FALSE(pairing.add(kRight, {kT - 15 * kMs, 1}));
  EXPECT_FALSE(pairing.add(kRight, {kT + 2 * kMs, 2}));
  EXPECT_FALSE(pairing.add(kRight, {kT + 12 * kMs, 3}));
  const auto pair = pairing.add(kLeft, {kT, 9});
  ASSERT_TRUE(pair);
  EXPECT_EQ(pair->right.frame_id, 2u);
  EXPECT_EQ(pairing.unpaired(kRight), 1u);
}

TEST(StereoPairing, FollowsCamerasWhoseClocksDriftApartByHundredsOfMilliseconds) {
  StereoPairing pairing(20 * kMs);
  int pairs = 0;
  constexpr int kFrames = 7200;  // an hour at 2 Hz
  for (int i = 0; i < kFrames; ++i) {
    const std::int64_t t = kT + i * 500 * kMs;
    const std::int64_t drift = (t - kT) / 10'000;  // 100 ppm: 360 ms in the hour
    const auto id = static_cast<std::uint32_t>(i);
    EXPECT_FALSE(pairing.add(kLeft, {t, id}));
    const auto pair = pairing.add(kRight, {t + drift, id});
    if (!pair) continue;
    EXPECT_EQ(pair->left.frame_id, pair->right.frame_id);
    ++pairs;
  }
  EXPECT_EQ(pairs, kFrames);
  EXPECT_NEAR(static_cast<double>(pairing.skewNs()), 360.0 * kMs, 2.0 * kMs);
}

TEST(StereoPairing, OneDeadCameraOverflowsTheWaitAndIsCounted) {
  StereoPairing pairing(20 * kMs);
  for (std::uint32_t i = 0; i < 100; ++i) EXPECT_FALSE(pairing.add(kLeft, {kT + i * 500 * kMs, i}));
  EXPECT_EQ(pairing.unpaired(kLeft), 84u);
  // The other camera, come back 16 frames late, still finds its partners.
  EXPECT_TRUE(pairing.add(kRight, {kT + 90 * 500 * kMs, 190}));
}

TEST(StereoPairing, RefusesRepeatedBackwardAndImpossibleTimes) {
  StereoPairing pairing(20 * kMs);
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

}  // namespace
}  // namespace fathom::onboard
