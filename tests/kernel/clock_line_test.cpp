#include "realtime/kernel/clock_line.hpp"

#include <gtest/gtest.h>

namespace fathom::rt {
namespace {

TEST(ClockLine, GoesThroughPointsOfAClockThatDrifts) {
  ClockLine line;
  for (int i = 0; i < 200; ++i) line.add({10.0 * i, 3 + 40e-6 * 10.0 * i});
  EXPECT_EQ(line.points().size(), ClockLine::Points::capacity());
  EXPECT_NEAR(line.rate(), 40e-6, 1e-12);
  EXPECT_NEAR(line.at(3600), 3 + 40e-6 * 3600, 1e-9);
}

TEST(ClockLine, BelievesAPointByItsSigma) {
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
}  // namespace fathom::rt
