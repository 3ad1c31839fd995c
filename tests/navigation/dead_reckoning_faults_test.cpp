#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "realtime/base/units.hpp"
#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"
#include "tests/world/analytic_dive.hpp"

namespace fathom::nav {
namespace {

using namespace fathom::nav::test;

// Longest move between poses 10 ms apart over the kept history [m].
double longestStep(const DeadReckoning& nav) {
  double longest = 0;
  std::optional<SE3> before;
  for (std::int64_t t = nav.oldestUtcNs(); t <= nav.newestUtcNs(); t += 10'000'000) {
    const auto pose = nav.poseAt(t);
    if (before && pose) longest = std::max(longest, (pose->translation() - before->translation()).norm());
    before = pose;
  }
  return longest;
}

template <typename Kind>
std::vector<Sample> without(const std::vector<Sample>& samples, double begin, double end) {
  std::vector<Sample> left;
  for (const Sample& sample : samples)
    if (!std::holds_alternative<Kind>(sample) || timeOf(sample) < at(begin) || timeOf(sample) >= at(end))
      left.push_back(sample);
  return left;
}

class DeadReckoningFaults : public ::testing::Test {
 protected:
  const DeadReckoningConfig config = mountedConfig();
  DeadReckoning nav{config};
};

TEST_F(DeadReckoningFaults, GarbageBetweenGoodSamplesIsCountedAndChangesNothing) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  DeadReckoning clean(config), dirty(config);
  int rounds = 0;
  for (const Sample& sample : samplesOf(circle, config, 20)) {
    feed(clean, sample);
    feed(dirty, sample);
    feed(dirty, sample);  // repeated
    const std::int64_t t = timeOf(sample);
    if (t < at(1)) continue;
    ++rounds;
    DvlSample late = dvlAt(circle, config, 0.5);
    dirty.add(late);  // out of order
    AttitudeSample attitude{t + 1, nan, 0, 0, true};
    dirty.add(attitude);
    dirty.add(AttitudeSample{t + 1, 0, 2.0, 0, true});    // pitched beyond the vertical
    dirty.add(AttitudeSample{t + 1, 0, 0, 1e300, true});  // no heading
    dirty.add(DepthSample{t + 1, nan});
    dirty.add(DepthSample{t + 1, 1e6});
    dirty.add(DepthSample{t + 3'600'000'000'000LL * rounds, 20});  // an hour ahead, alone
    dirty.add(DepthSample{std::numeric_limits<std::int64_t>::max() - rounds % 2, 20});  // and the end of time
    WaterSample water;
    water.utc_ns = t;
    water.sound_speed = nan;
    dirty.add(water);
    water.sound_speed = 300;
    dirty.add(water);
  }
  const std::int64_t newest = clean.newestUtcNs();
  ASSERT_EQ(dirty.newestUtcNs(), newest);
  EXPECT_EQ(dirty.poseAt(newest)->translation(), clean.poseAt(newest)->translation());
  EXPECT_EQ(dirty.poseAt(newest)->rotation().coeffs(), clean.poseAt(newest)->rotation().coeffs());
  const auto n = static_cast<std::uint64_t>(rounds);
  EXPECT_EQ(dirty.counters().attitude_rejected, 3 * n);
  EXPECT_EQ(dirty.counters().depth_rejected, 2 * n);
  EXPECT_EQ(dirty.counters().water_rejected, 2 * n);
  EXPECT_EQ(dirty.counters().time_leaps, 2 * n);
  EXPECT_GE(dirty.counters().out_of_order, 2 * n);
  EXPECT_EQ(clean.counters().out_of_order, 0u);
}

TEST_F(DeadReckoningFaults, VelocitiesThatCannotBeAreRejected) {
  std::uint64_t absurd = 0;
  auto samples = samplesOf(circle, config, 20, {7, 10, 5});
  for (Sample& sample : samples) {
    auto* ensemble = std::get_if<DvlSample>(&sample);
    if (ensemble != nullptr && timeOf(sample) > at(1) && ++absurd % 3 == 0)
      ensemble->velocity = absurd % 2 == 0 ? Eigen::Vector3d(0, 30, 0) : Eigen::Vector3d(NAN, 0, 0);
    feed(nav, sample);
  }
  EXPECT_EQ(nav.counters().dvl_rejected, absurd / 3);
  EXPECT_LT(positionError(*nav.poseAt(at(19)), circle, 19), 0.02);
}

TEST_F(DeadReckoningFaults, AShortLossOfBottomTrackIsBridgedAlongTheTurn) {
  auto samples = samplesOf(circle, config, 20);
  for (Sample& sample : samples) {
    auto* ensemble = std::get_if<DvlSample>(&sample);
    if (ensemble != nullptr && timeOf(sample) > at(10) && timeOf(sample) < at(11.5))
      ensemble->velocity.reset();
    feed(nav, sample);
  }
  EXPECT_EQ(nav.counters().dvl_without_bottom, 8u);
  EXPECT_EQ(nav.counters().coasted, 0u);
  EXPECT_LT(positionError(*nav.poseAt(at(19)), circle, 19), 0.1);
  EXPECT_LT(longestStep(nav), 0.012);
}

TEST_F(DeadReckoningFaults, ALongLossOfBottomTrackStopsSmoothlyAndGoesOn) {
  const auto samples = samplesOf(circle, config, 45);
  const double begin = 5, end = 35;
  bool checked = false;
  for (const Sample& sample : without<DvlSample>(samples, begin, end)) {
    feed(nav, sample);
    if (!checked && timeOf(sample) > at(30)) {
      checked = true;
      EXPECT_GT(nav.newestUtcNs(), at(29));  // the track continues without the DVL
      EXPECT_LT(nav.velocityBody().norm(), 0.01);
      EXPECT_FALSE(nav.altitude());
      const double moved =
          (nav.poseAt(at(28))->translation() - nav.poseAt(at(begin))->translation()).head<2>().norm();
      // Held for 2 s, then decaying with 2 s: about 4 m at 1 m/s, a little less in the turn.
      EXPECT_GT(moved, 3.0);
      EXPECT_LT(moved, 4.3);
    }
  }
  EXPECT_TRUE(checked);
  EXPECT_EQ(nav.counters().coasted, 1u);
  EXPECT_LT(longestStep(nav), 0.012);
  EXPECT_NEAR(nav.velocityBody().x(), 1.0, 0.1);
}

// The velocity stays, however long, that of the moment it froze: the track must know that it no longer knows
// it.
TEST_F(DeadReckoningFaults, ADvlThatSendsTheSameForSecondsIsNotUsed) {
  constexpr double kBegin = 5, kEnd = 25;
  std::optional<DvlSample> frozen;
  for (Sample& sample : samplesOf(circle, config, 45)) {
    auto* ensemble = std::get_if<DvlSample>(&sample);
    if (ensemble != nullptr && timeOf(sample) >= at(kBegin) && timeOf(sample) < at(kEnd)) {
      if (!frozen) {
        frozen = *ensemble;
        frozen->range.fill(2.0);
      }
      const std::int64_t stamp = ensemble->utc_ns;
      *ensemble = *frozen;
      ensemble->utc_ns = stamp;
    }
    feed(nav, sample);
  }
  // A second of it is used, at 5 Hz.
  EXPECT_EQ(nav.counters().dvl_rejected, 5 * (kEnd - kBegin) - 5);
  EXPECT_NEAR(nav.qualityAt(at(40)).unlocked_s, kEnd - kBegin - 1, 0.4);
}

TEST_F(DeadReckoningFaults, ADvlThatArrivesLateIsTakenUpAgainAfterALongLoss) {
  auto samples = without<DvlSample>(samplesOf(circle, config, 45), 5, 20);
  // Ensembles reach the vehicle a quarter of a second after the others' samples of their time.
  const auto arrival = [](const Sample& sample) {
    return timeOf(sample) + (std::holds_alternative<DvlSample>(sample) ? 250'000'000 : 0);
  };
  std::stable_sort(samples.begin(), samples.end(),
                   [&](const Sample& a, const Sample& b) { return arrival(a) < arrival(b); });
  for (const Sample& sample : samples) feed(nav, sample);
  EXPECT_LE(nav.counters().out_of_order, 3u);
  EXPECT_GT(nav.counters().dvl_used, 140u);
  EXPECT_NEAR(nav.qualityAt(nav.newestUtcNs()).unlocked_s, 15, 0.6);
  EXPECT_NEAR(nav.velocityBody().x(), 1.0, 0.1);
  EXPECT_LT(longestStep(nav), 0.012);
}

TEST_F(DeadReckoningFaults, WithoutDepthTheDvlCarriesItAndItsReturnIsNoJump) {
  feed(nav, without<DepthSample>(samplesOf(circle, config, 20), 5, 15));
  EXPECT_GT(nav.counters().depth_held, 0u);
  EXPECT_GT(nav.newestUtcNs(), at(19));
  EXPECT_LT(positionError(*nav.poseAt(at(14)), circle, 14), 0.02);
  EXPECT_LT(positionError(*nav.poseAt(at(19)), circle, 19), 0.02);
  EXPECT_LT(longestStep(nav), 0.012);
}

TEST_F(DeadReckoningFaults, ADepthSensorThatReturnsWithAnotherValueClosesTheDifferenceSlowly) {
  auto samples = without<DepthSample>(samplesOf(circle, config, 60), 5, 15);
  for (Sample& sample : samples) {
    auto* depth = std::get_if<DepthSample>(&sample);
    if (depth != nullptr && timeOf(sample) >= at(15)) depth->depth += 1.0;
    feed(nav, sample);
  }
  EXPECT_LT(longestStep(nav), 0.013);
  EXPECT_NEAR(nav.poseAt(at(58))->translation().z(), circle(58).translation().z() + 1.0, 0.01);
}

TEST_F(DeadReckoningFaults, ASilentCompassIsNotWaitedForForEver) {
  feed(nav, without<AttitudeSample>(samplesOf(circle, config, 20), 10, 100));
  EXPECT_GT(nav.newestUtcNs(), at(18));
  EXPECT_GT(nav.counters().attitude_held, 0u);
  EXPECT_LT(longestStep(nav), 0.02);
}

// Level, around a circle, slowly sinking: still visible in samples seconds apart.
SE3 spiral(double t) {
  const double phase = 0.1 * t;
  return SE3::fromEuler(0, 0, phase + std::numbers::pi / 2,
                        {10 * std::cos(phase), 10 * std::sin(phase), 20 + 0.1 * t});
}

TEST_F(DeadReckoningFaults, APressureSensorThatSpeaksEveryTwoSecondsIsNotSilent) {
  std::vector<Sample> samples = without<DepthSample>(samplesOf(spiral, config, 60, {5, 10, 0.5}), 29, 31);
  double worst = 0;
  for (const Sample& sample : samples) {
    feed(nav, sample);
    if (!nav.initialised() || timeOf(sample) < at(5)) continue;
    const double t = static_cast<double>(nav.newestUtcNs() - kStart) * 1e-9;
    worst = std::max(worst, positionError(*nav.poseAt(nav.newestUtcNs()), spiral, t));
  }
  EXPECT_EQ(nav.counters().depth_held, 0u);  // one of its samples was lost
  EXPECT_GT(nav.newestUtcNs(), at(57));
  EXPECT_LT(worst, 0.004);
}

TEST_F(DeadReckoningFaults, ACompassThatSpeaksEveryTwoAndAHalfSecondsIsNotSilent) {
  feed(nav, without<AttitudeSample>(samplesOf(spiral, config, 60, {5, 0.4, 5}), 29, 31));
  EXPECT_EQ(nav.counters().attitude_held, 0u);  // one of its samples was lost
  EXPECT_GT(nav.newestUtcNs(), at(56));
  EXPECT_LT(positionError(*nav.poseAt(at(56)), spiral, 56), 0.004);
}

TEST_F(DeadReckoningFaults, ASlowSensorThatFallsSilentIsWaitedForThreeOfItsPeriods) {
  double held_since = 0;
  for (const Sample& sample : without<DepthSample>(samplesOf(spiral, config, 60, {5, 10, 0.5}), 30, 100)) {
    feed(nav, sample);
    if (held_since == 0 && nav.counters().depth_held > 0)
      held_since = static_cast<double>(timeOf(sample) - kStart) * 1e-9;
  }
  EXPECT_NEAR(held_since, 28.013 + 6, 0.2);
  EXPECT_GT(nav.newestUtcNs(), at(59));
}

TEST_F(DeadReckoningFaults, VelocitiesWaitForALateAttitudeAndLoseNothing) {
  DeadReckoning prompt(config), delayed(config);
  auto samples = samplesOf(circle, config, 20);
  feed(prompt, samples);
  // The compass arrives 0.3 s after its time of validity.
  std::stable_sort(samples.begin(), samples.end(), [](const Sample& a, const Sample& b) {
    const auto arrival = [](const Sample& s) {
      return timeOf(s) + (std::holds_alternative<AttitudeSample>(s) ? 300'000'000 : 0);
    };
    return arrival(a) < arrival(b);
  });
  feed(delayed, samples);
  EXPECT_EQ(delayed.counters().dvl_used, prompt.counters().dvl_used);
  EXPECT_EQ(delayed.poseAt(at(19))->translation(), prompt.poseAt(at(19))->translation());
}

TEST_F(DeadReckoningFaults, AnEnsembleWithoutASoundSpeedCountsAsCorrected) {
  auto samples = samplesOf(circle, config, 10);
  for (Sample& sample : samples) {
    if (auto* ensemble = std::get_if<DvlSample>(&sample)) {
      ensemble->velocity = *ensemble->velocity * (*config.sound_speed / ensemble->sound_speed);
      ensemble->sound_speed = 0;
    }
    feed(nav, sample);
  }
  EXPECT_GT(nav.counters().sound_speed_absent, 40u);
  EXPECT_LT(positionError(*nav.poseAt(at(9)), circle, 9), 0.005);
}

TEST_F(DeadReckoningFaults, WhatTheTrackRestedOnIsKnownForEachMomentOfIt) {
  auto samples = without<AttitudeSample>(samplesOf(circle, config, 20), 8, 12);
  for (Sample& sample : samples) {
    if (auto* attitude = std::get_if<AttitudeSample>(&sample); attitude && attitude->utc_ns >= at(15.05))
      attitude->heading += 40 * kRadiansPerDegree;
    auto* ensemble = std::get_if<DvlSample>(&sample);
    if (ensemble != nullptr && timeOf(sample) > at(16) && timeOf(sample) < at(19)) ensemble->velocity.reset();
    feed(nav, sample);
  }
  EXPECT_FALSE(nav.qualityAt(at(7.8)).attitude_held);
  EXPECT_TRUE(nav.qualityAt(at(10)).attitude_held);
  EXPECT_FALSE(nav.qualityAt(at(12.5)).attitude_held);
  const auto untilted = [&](double t) { return nav.qualityAt(at(t)).untilted_s; };
  EXPECT_EQ(untilted(7.8), 0);
  EXPECT_NEAR(untilted(11) - untilted(10), 1, 1e-9);
  EXPECT_EQ(untilted(14) - untilted(12.5), 0);
  EXPECT_EQ(nav.qualityAt(at(15)).heading_leaps, 0U);
  EXPECT_EQ(nav.qualityAt(at(15.1)).heading_leaps, 1U);
  EXPECT_EQ(nav.qualityAt(at(15.837)).unlocked_s, 0);  // the last ensemble with bottom track
  EXPECT_NEAR(nav.qualityAt(at(18)).unlocked_s, 18 - 15.837, 1e-6);
  EXPECT_EQ(nav.qualityAt(at(25)).unlocked_s, nav.qualityAt(nav.newestUtcNs()).unlocked_s);
}

TEST_F(DeadReckoningFaults, ACompassThatLeapsDoesNotBendTheTrack) {
  DeadReckoning clean(config), leapt(config);
  for (Sample sample : samplesOf(circle, config, 30)) {
    feed(clean, sample);
    // Twenty degrees off from the tenth second on, and one wild heading before.
    if (auto* attitude = std::get_if<AttitudeSample>(&sample)) {
      if (attitude->utc_ns >= at(10)) attitude->heading += 20 * kRadiansPerDegree;
      if (attitude->utc_ns == at(5)) attitude->heading += 90 * kRadiansPerDegree;
    }
    feed(leapt, sample);
  }
  EXPECT_EQ(clean.counters().heading_leaps, 0U);
  EXPECT_EQ(leapt.counters().heading_leaps, 3U);  // the wild one there and back
  const SE3 a = *clean.poseAt(clean.newestUtcNs()), b = *leapt.poseAt(clean.newestUtcNs());
  // What the vehicle turned by between the samples of each leap is all that is lost: 0.6 degrees each.
  EXPECT_LT((a.translation() - b.translation()).norm(), 0.03 * 25);
  EXPECT_LT(a.rotation().angularDistance(b.rotation()), 2 * kRadiansPerDegree);
}

}  // namespace
}  // namespace fathom::nav
