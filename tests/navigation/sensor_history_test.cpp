#include "recon/navigation/dead_reckoning/sensor_history.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

namespace fathom::nav {
namespace {

TEST(TimeGate, TakesGrowingTimesOnly) {
  TimeGate gate;
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kOutOfOrder);
  EXPECT_EQ(gate.check(9 * kSecond_ns), TimeCheck::kOutOfOrder);
  EXPECT_EQ(gate.check(11 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.newestUtcNs(), 11 * kSecond_ns);
}

TEST(TimeGate, DropsALoneStampFarAheadAndGoesOn) {
  TimeGate gate;
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(1000 * kSecond_ns), TimeCheck::kLeap);
  EXPECT_EQ(gate.check(11 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(1001 * kSecond_ns), TimeCheck::kLeap);
}

TEST(TimeGate, AcceptsARealGapFromItsSecondSample) {
  TimeGate gate;
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(1000 * kSecond_ns), TimeCheck::kLeap);
  EXPECT_EQ(gate.check(1001 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(1002 * kSecond_ns), TimeCheck::kGood);
}

TEST(TimeGate, RefusesTimesThatAreNone) {
  TimeGate gate;
  EXPECT_EQ(gate.check(std::numeric_limits<std::int64_t>::min()), TimeCheck::kImpossible);
  EXPECT_EQ(gate.check(std::numeric_limits<std::int64_t>::max()), TimeCheck::kImpossible);
  EXPECT_EQ(gate.check(0), TimeCheck::kImpossible);
  EXPECT_FALSE(gate.any());
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kGood);
}

// Of a sensor that speaks every `interval`, some of whose samples are lost.
std::int64_t silenceAfter(std::int64_t interval, int samples, const std::vector<int>& lost) {
  TimeGate gate;
  for (int i = 0; i < samples; ++i)
    if (std::find(lost.begin(), lost.end(), i) == lost.end()) {
      EXPECT_EQ(gate.check(kSecond_ns + i * interval), TimeCheck::kGood);
    }
  return gate.silenceNs();
}

TEST(TimeGate, ASensorIsSilentAfterThreeOfItsPeriodsWithinBounds) {
  EXPECT_EQ(silenceAfter(kSecond_ns / 10, 20, {}), kSecond_ns);
  EXPECT_EQ(silenceAfter(2 * kSecond_ns, 20, {}), 6 * kSecond_ns);
  EXPECT_EQ(silenceAfter(4 * kSecond_ns, 20, {}), 10 * kSecond_ns);
  EXPECT_EQ(silenceAfter(2 * kSecond_ns, 2, {}), 6 * kSecond_ns);
  EXPECT_EQ(silenceAfter(2 * kSecond_ns, 1, {}), 10 * kSecond_ns);  // nothing is known of it yet
}

TEST(TimeGate, ALostSampleOrAnOutageDoesNotChangeThePeriod) {
  EXPECT_EQ(silenceAfter(2 * kSecond_ns, 20, {15}), 6 * kSecond_ns);
  EXPECT_EQ(silenceAfter(kSecond_ns / 5, 100, {90, 91, 92, 93, 94, 95, 96}), kSecond_ns);
}

TEST(TimeGate, TakesEverySampleOfASensorThatSpeaksEveryFourSecondsAlsoBehindALostOne) {
  TimeGate gate;
  for (int i = 1; i < 20; ++i)
    if (i != 10) {
      EXPECT_EQ(gate.check(4 * i * kSecond_ns), TimeCheck::kGood);
    }
}

TEST(SensorHistory, InterpolatesBetweenAndHoldsBeyondItsEnds) {
  NumberHistory history;
  history.pushDroppingOldest({10, 1.0});
  EXPECT_EQ(numberAt(history, 5), 1.0);
  EXPECT_EQ(numberAt(history, 15), 1.0);
  history.pushDroppingOldest({20, 3.0});
  EXPECT_DOUBLE_EQ(numberAt(history, 15), 2.0);
  EXPECT_EQ(numberAt(history, 10), 1.0);
  EXPECT_EQ(numberAt(history, 25), 3.0);
}

TEST(SensorHistory, RotationsTakeTheShortArc) {
  RotationHistory history;
  const Eigen::Quaterniond a(Eigen::AngleAxisd(3.0, Eigen::Vector3d::UnitZ()));
  Eigen::Quaterniond b(Eigen::AngleAxisd(3.4, Eigen::Vector3d::UnitZ()));
  b.coeffs() = -b.coeffs();  // the same rotation
  history.pushDroppingOldest({0, a});
  history.pushDroppingOldest({10, b});
  const Eigen::Quaterniond middle(Eigen::AngleAxisd(3.2, Eigen::Vector3d::UnitZ()));
  EXPECT_LT(rotationAt(history, 5).angularDistance(middle), 1e-9);
}

TEST(SensorHistory, FindsTheFirstElementAfterATime) {
  NumberHistory history;
  EXPECT_EQ(firstAfter(history, 0), 0u);
  for (int i = 1; i <= 5; ++i) history.pushDroppingOldest({10 * i, 0.0});
  EXPECT_EQ(firstAfter(history, 0), 0u);
  EXPECT_EQ(firstAfter(history, 10), 1u);
  EXPECT_EQ(firstAfter(history, 34), 3u);
  EXPECT_EQ(firstAfter(history, 50), 5u);
}

}  // namespace
}  // namespace fathom::nav
