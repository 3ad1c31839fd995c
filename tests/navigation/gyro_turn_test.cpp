#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "realtime/base/units.hpp"
#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"
#include "tests/world/analytic_dive.hpp"

namespace fathom::nav {
namespace {

using namespace fathom::nav::test;

constexpr double kCircleRate = 0.1;  // of heading, around the circle [rad/s]

// What the gyro says between two times, each asked for as soon as the track has reached it.
struct Said {
  double turn = 0, silent = 0;
};
Said between(const std::vector<Sample>& samples, double from, double to) {
  DeadReckoning nav(mountedConfig());
  std::optional<DeadReckoning::Quality> first, last;
  for (const Sample& sample : samples) {
    feed(nav, sample);
    if (!first && nav.newestUtcNs() >= at(from)) first = nav.qualityAt(at(from));
    if (!last && nav.newestUtcNs() >= at(to)) last = nav.qualityAt(at(to));
  }
  EXPECT_TRUE(first && last && last->has_gyro);
  return {last->gyro_turn - first->gyro_turn, last->ungyro_s - first->ungyro_s};
}

TEST(GyroTurn, FollowsTheHeadingThroughWholeTurnsOfARollingVehicle) {
  // 190 s: three turns, rolling and pitching; the gyro is mounted askew, and faster or slower than the nodes.
  for (const double rate : {10.0, 25.0, 100.0}) {
    const Said said = between(samplesOf(circle, mountedConfig(), 200, {5, 10, 5, rate}), 4.123, 194.321);
    EXPECT_NEAR(said.turn, kCircleRate * (194.321 - 4.123), 2e-4) << rate;
    EXPECT_EQ(said.silent, 0) << rate;
  }
}

TEST(GyroTurn, IsThatOfThePairsOwnTimeNotOfTheNewestSample) {
  // Heading swings by 17 degrees in 8 s; the compass speaks once a second, the gyro ten times.
  const Path swing = [](double t) { return SE3::fromEuler(0, 0, 0.3 * std::sin(0.8 * t), {0, 0, 15}); };
  DeadReckoning nav(mountedConfig());
  feed(nav, samplesOf(swing, mountedConfig(), 20, {1, 1, 5, 10}));
  const double zero = nav.qualityAt(at(5)).gyro_turn - swing(5).euler().z();
  double worst = 0;
  for (double t = 5; t < 18; t += 0.031)
    worst = std::max(worst, std::abs(nav.qualityAt(at(t)).gyro_turn - zero - swing(t).euler().z()));
  EXPECT_LT(worst, 5e-4);  // trapezoids of the gyro's 0.1 s
}

TEST(GyroTurn, ARateOfHeadingAloneCountsAsItIs) {
  std::vector<Sample> samples = samplesOf(circle, mountedConfig(), 60, {5, 10, 5, 10});
  for (Sample& sample : samples)
    if (auto* gyro = std::get_if<GyroSample>(&sample)) *gyro = {gyro->utc_ns, {}, kCircleRate};
  EXPECT_NEAR(between(samples, 10, 50).turn, kCircleRate * 40, 1e-9);
}

TEST(GyroTurn, AWrongCompassDoesNotBendIt) {
  std::vector<Sample> samples = samplesOf(circle, mountedConfig(), 60, {5, 10, 5, 10});
  for (Sample& sample : samples)
    if (auto* attitude = std::get_if<AttitudeSample>(&sample)) {
      const double t = static_cast<double>(attitude->utc_ns - kStart) * 1e-9;
      attitude->heading += 40 * kRadiansPerDegree * std::exp(-0.5 * std::pow((t - 30) / 6, 2));
    }
  EXPECT_NEAR(between(samples, 10, 30).turn, kCircleRate * 20, 2e-4);
}

// By 8 degrees between 40 and 45 s, as over a wreck: 1.2 in the mean of all 50 s.
TEST(GyroTurn, ShowsWhatTurnsTheCompassUnderway) {
  std::vector<Sample> samples = samplesOf(circle, mountedConfig(), 60, {5, 10, 5, 10});
  const auto beyondMean = [&] {
    DeadReckoning nav(mountedConfig());
    feed(nav, samples);
    const DeadReckoning::Quality quality = nav.qualityAt(at(50));
    EXPECT_GT(quality.compass_off_s, 0);
    return quality.compassBeyondMean() / kRadiansPerDegree;
  };
  EXPECT_NEAR(beyondMean(), 0, 0.1);
  for (Sample& sample : samples)
    if (auto* attitude = std::get_if<AttitudeSample>(&sample)) {
      const double t = static_cast<double>(attitude->utc_ns - kStart) * 1e-9;
      attitude->heading += 8 * kRadiansPerDegree * std::clamp((t - 40) / 5, 0.0, 1.0);
    }
  EXPECT_NEAR(beyondMean(), 6.8, 0.2);
  std::erase_if(samples, [](const Sample& s) {
    return std::holds_alternative<GyroSample>(s) && timeOf(s) > at(46) && timeOf(s) < at(48);
  });
  EXPECT_NEAR(beyondMean(), 0, 0.1);  // what was before the silence is not known here
}

TEST(GyroTurn, SilenceAddsNothingAndIsCounted) {
  std::vector<Sample> samples = samplesOf(circle, mountedConfig(), 60, {5, 10, 5, 10});
  std::erase_if(samples, [](const Sample& s) {
    return std::holds_alternative<GyroSample>(s) && timeOf(s) > at(20.01) && timeOf(s) < at(30);
  });
  const Said said = between(samples, 10, 50);
  EXPECT_NEAR(said.silent, 10.1, 1e-6);  // from 20.007 to 30.107: a gap costs its first sample (TimeGate)
  EXPECT_NEAR(said.turn, kCircleRate * 29.9, 2e-4);
}

TEST(GyroTurn, ADyingGyroHoldsTheTrackUpForASecondAtMost) {
  std::vector<Sample> samples = samplesOf(circle, mountedConfig(), 60, {5, 10, 5, 10});
  std::erase_if(samples,
                [](const Sample& s) { return std::holds_alternative<GyroSample>(s) && timeOf(s) > at(20); });
  DeadReckoning nav(mountedConfig());
  std::int64_t longest = 0;
  for (const Sample& sample : samples) {
    feed(nav, sample);
    if (timeOf(sample) > at(1)) longest = std::max(longest, timeOf(sample) - nav.newestUtcNs());
  }
  EXPECT_LT(longest, 1'300'000'000);
  EXPECT_LT(positionError(*nav.poseAt(at(59)), circle, 59), 0.002);
  EXPECT_NEAR(nav.qualityAt(at(59)).ungyro_s, 59 - 19.907 - 0.03, 0.2);
}

TEST(GyroTurn, WithoutAGyroNothingIsSaid) {
  DeadReckoning nav(mountedConfig());
  feed(nav, samplesOf(circle, mountedConfig(), 10));
  const DeadReckoning::Quality quality = nav.qualityAt(at(9));
  EXPECT_FALSE(quality.has_gyro);
  EXPECT_EQ(quality.gyro_turn, 0);
}

TEST(GyroTurn, RatesThatCannotBeAreRejectedAndChangeNothing) {
  DeadReckoning clean(mountedConfig()), dirty(mountedConfig());
  std::uint64_t rejected = 0;
  for (const Sample& sample : samplesOf(circle, mountedConfig(), 20, {5, 10, 5, 10})) {
    feed(clean, sample);
    feed(dirty, sample);
    if (!std::holds_alternative<GyroSample>(sample)) continue;
    const std::int64_t t = timeOf(sample) + 1;
    dirty.add(GyroSample{t, {}, {}});
    dirty.add(GyroSample{t, Eigen::Vector3d(0, 0, 11), {}});
    dirty.add(GyroSample{t, {}, std::numeric_limits<double>::quiet_NaN()});
    rejected += 3;
  }
  EXPECT_EQ(dirty.counters().gyro_rejected, rejected);
  EXPECT_EQ(dirty.counters().gyro_used, clean.counters().gyro_used);
  EXPECT_EQ(dirty.qualityAt(at(19)).gyro_turn, clean.qualityAt(at(19)).gyro_turn);
}

}  // namespace
}  // namespace fathom::nav
