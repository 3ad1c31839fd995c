#include <gtest/gtest.h>

#include "realtime/kernel/time/clock.hpp"
#include "realtime/kernel/time/clock_line.hpp"
#include "realtime/kernel/time/retry_wait.hpp"

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

namespace {

TEST(ClockLine, GoesThroughPointsOfAClockThatDrifts) {
  ClockLine line;
  for (int i = 0; i < 200; ++i) line.add({10.0 * i, 3 + 40e-6 * 10.0 * i});
  EXPECT_EQ(line.points().size(), ClockLine::Points::capacity());
  EXPECT_NEAR(line.rate(), 40e-6, 1e-12);
  EXPECT_NEAR(line.at(3600), 3 + 40e-6 * 3600, 1e-9);
}

TEST(ClockLine, WeightsAPointByItsSigma) {
  ClockLine line;
  line.add({0, 1, 1e-6});
  line.add({1, 1, 1e-6});
  line.add({0.5, 2, 1e-3});
  EXPECT_NEAR(line.at(0.5), 1, 1e-5);
}

TEST(ClockLine, InventsNoRateFromAShortHistoryWhereThereIsAPrior) {
  ClockLine free, held(50e-6);
  for (ClockLine* line : {&free, &held}) {
    line->add({0, 0, 1e-3});
    line->add({1, 2e-3, 1e-3});
  }
  EXPECT_NEAR(free.rate(), 2e-3, 1e-12);
  EXPECT_LT(held.rate(), 10e-6);
}

TEST(ClockLine, StaysAsItIsWithoutPointsAndLevelAfterARestart) {
  ClockLine line;
  line.add({0, 1});
  line.add({10, 2});
  line.forgetPoints();
  EXPECT_NEAR(line.at(20), 3, 1e-12);
  line.hold(5);
  EXPECT_EQ(line.at(20), 5);
  line.restart();
  EXPECT_EQ(line.at(20), 0);
}

}  // namespace

namespace {

TEST(RetryWait, GrowsWithEachFailureToItsLongestAndResetsAfterASuccess) {
  RetryWait wait(10, 35);
  EXPECT_TRUE(wait.due(INT64_MIN)) << "nothing has failed yet";
  wait.failed(0);
  EXPECT_FALSE(wait.due(9));
  EXPECT_TRUE(wait.due(10));
  wait.failed(10);
  EXPECT_FALSE(wait.due(29));
  EXPECT_TRUE(wait.due(30));
  for (int i = 0; i < 100; ++i) wait.failed(30);
  EXPECT_FALSE(wait.due(64));
  EXPECT_TRUE(wait.due(65));
  wait.succeeded();
  EXPECT_TRUE(wait.due(0));
  wait.failed(0);
  EXPECT_TRUE(wait.due(10));
}

}  // namespace
}  // namespace fathom::rt
