#include "realtime/kernel/clock.hpp"

#include <gtest/gtest.h>

namespace fathom::rt {
namespace {

TEST(RealClock, SleepsUntilTheMomentAskedForAndNotLess) {
  RealClock clock;
  const std::int64_t wanted = clock.monotonicNs() + 2'000'000;
  clock.sleepUntil(wanted);
  EXPECT_GE(clock.monotonicNs(), wanted);
}

TEST(RealClock, ReturnsAtOnceForAMomentThatIsPast) {
  RealClock clock;
  clock.sleepUntil(0);
  clock.sleepUntil(-5);
  clock.sleepUntil(clock.monotonicNs() - 1);
}

TEST(RealClock, CountsUtcFromTheUnixEpoch) {
  const RealClock clock;
  constexpr std::int64_t kStartOf2024 = 1'704'067'200'000'000'000;
  EXPECT_GT(clock.utcNs(), kStartOf2024);
}

TEST(ReplayedClock, StandsStillUntilTheLogMovesIt) {
  ReplayedClock clock(1000);
  EXPECT_EQ(clock.utcNs(), 1000);
  EXPECT_EQ(clock.monotonicNs(), 0);
  clock.setUtc(1500);
  EXPECT_EQ(clock.utcNs(), 1500);
  EXPECT_EQ(clock.monotonicNs(), 500);
}

TEST(ReplayedClock, MonotonicTimeNeverGoesBackWithUtc) {
  ReplayedClock clock(1000);
  clock.setUtc(2000);
  clock.setUtc(1200);
  EXPECT_EQ(clock.utcNs(), 1200);
  EXPECT_EQ(clock.monotonicNs(), 1000);
  clock.setUtc(1300);
  EXPECT_EQ(clock.monotonicNs(), 1100);
}

TEST(ReplayedClock, SleepingMovesTheTimeOnAndThePastDoesNot) {
  ReplayedClock clock(0);
  clock.sleepUntil(700);
  EXPECT_EQ(clock.monotonicNs(), 700);
  EXPECT_EQ(clock.utcNs(), 700);
  clock.sleepUntil(100);
  EXPECT_EQ(clock.monotonicNs(), 700);
}

}  // namespace
}  // namespace fathom::rt
