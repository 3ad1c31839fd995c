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

}  // namespace
}  // namespace fathom::rt
