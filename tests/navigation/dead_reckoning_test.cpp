#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "recon/geometry/geodesy.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/world/analytic_dive.hpp"

namespace fathom::nav {
namespace {

using namespace fathom::nav::test;

// 1 m/s at a heading of 0.3 rad.
SE3 straight(double t) {
  return SE3::fromEuler(0, 0, 0.3, {std::cos(0.3) * t, std::sin(0.3) * t, 5});
}

double worstErrorOver(const DeadReckoning& nav, const Path& path, double begin, double end) {
  double worst = 0;
  for (double t = begin; t < end; t += 0.05) {
    const auto pose = nav.poseAt(at(t));
    if (!pose) return INFINITY;
    worst = std::max(worst, positionError(*pose, path, t));
  }
  return worst;
}

TEST(DeadReckoning, FollowsACircleDespiteLeverArmsMountingDeclinationAndSoundSpeed) {
  const DeadReckoningConfig config = mountedConfig();
  DeadReckoning nav(config);
  double worst = 0, checked = 0.1;
  for (const Sample& sample : samplesOf(circle, config, 180)) {
    feed(nav, sample);
    for (; nav.initialised() && at(checked) <= nav.newestUtcNs(); checked += 0.11) {
      const auto pose = nav.poseAt(at(checked));
      ASSERT_TRUE(pose);
      worst = std::max(worst, positionError(*pose, circle, checked));
      const double angle = pose->rotation().angularDistance(circle(checked).rotation());
      EXPECT_LT(angle, 0.02 * kRadiansPerDegree);
    }
  }
  EXPECT_GT(checked, 179);
  EXPECT_LT(worst, 0.002);  // over 180 m travelled
}

TEST(DeadReckoning, StaysWithinMillimetresWhenEnsemblesComeOnlyTwiceASecond) {
  const DeadReckoningConfig config = mountedConfig();
  DeadReckoning nav(config);
  feed(nav, samplesOf(circle, config, 100, {2, 10, 5}));
  EXPECT_LT(worstErrorOver(nav, circle, 85, 99), 0.003);
}

TEST(DeadReckoning, TurningOnTheSpotDoesNotMoveTheBodyWhateverTheLeverArm) {
  const Path turn = [](double t) { return SE3::fromEuler(0, 0, 0.3 * std::sin(0.8 * t), {0, 0, 15}); };
  DeadReckoningConfig config = mountedConfig();
  config.T_body_dvl = SE3::fromEuler(0, 0, 0, {-2, 0, 0});
  DeadReckoning nav(config);
  feed(nav, samplesOf(turn, config, 60));
  EXPECT_LT(worstErrorOver(nav, turn, 45, 59), 0.005);
  EXPECT_LT(nav.velocityBody().norm(), 0.03);
}

TEST(DeadReckoning, AWaterSampleCorrectsTheScaleOfTheTrack) {
  const DeadReckoningConfig truth = mountedConfig();  // 1530 m/s
  DeadReckoningConfig wrong = truth;
  wrong.sound_speed = 1500;
  DeadReckoning without(wrong), with(wrong);
  WaterSample water;
  water.utc_ns = kStart - 1;
  water.sound_speed = 1530;
  with.add(water);
  const auto samples = samplesOf(straight, truth, 15);
  feed(without, samples);
  feed(with, samples);
  EXPECT_NEAR(positionError(*without.poseAt(at(14)), straight, 14), 14.0 * 30 / 1530, 0.01);
  EXPECT_LT(positionError(*with.poseAt(at(14)), straight, 14), 0.001);
  EXPECT_NEAR(*with.altitude(), 2.0 * 1530 / 1500, 1e-12);  // ranges scale as velocities do
}

TEST(DeadReckoning, ASoundSpeedOfTheInstrumentAloneLeavesTheScaleLessCertain) {
  for (const double own : {1435.0, 1535.0, 1500.0}) {
    DeadReckoningConfig truth = mountedConfig();
    truth.sound_speed = own;  // and computed by the instrument
    DeadReckoningConfig unknown = truth;
    unknown.sound_speed.reset();
    DeadReckoning nav(unknown), stated(truth);
    for (int tick = 0; tick <= 150; ++tick) {
      const double t = 0.1 * tick;
      for (DeadReckoning* track : {&nav, &stated}) {
        track->add(attitudeAt(straight, truth, t));
        track->add(depthAt(straight, truth, t));
        if (tick % 2 == 0) track->add(dvlAt(straight, truth, t, own));
      }
    }
    const double path = (nav.poseAt(at(14))->translation() - nav.poseAt(at(4))->translation()).norm();
    EXPECT_NEAR(path, 10, 0.001) << own;
    EXPECT_EQ(nav.qualityAt(at(14)).sound_share, own == 1500 ? 0.025 : 0.005) << own;
    EXPECT_EQ(stated.qualityAt(at(14)).sound_share, 0) << own;
    nav.add([] {
      WaterSample water;
      water.sound_speed = 1501;
      return water;
    }());
    EXPECT_EQ(nav.qualityAt(at(14)).sound_share, 0) << own;
  }
}

TEST(DeadReckoning, APhasedArraysHorizontalVelocityNeedsNoSoundSpeed) {
  DeadReckoningConfig truth;
  truth.sound_speed = 1500;
  DeadReckoningConfig config = truth;
  config.phased_array = true;
  config.sound_speed = 1430;
  DeadReckoning nav(config);
  feed(nav, samplesOf(straight, truth, 15));
  EXPECT_LT(positionError(*nav.poseAt(at(14)), straight, 14), 0.001);
  EXPECT_NEAR(*nav.altitude(), 2.0 * 1430 / 1500, 1e-12);
}

// Due east in the grid, 20 km at 60 degrees of latitude: the compass measures the angle to the meridian.
TEST(DeadReckoning, FollowsTheGridWhereMeridiansConverge) {
  constexpr double kSpeed = 20, kSeconds = 1000, kLatitude = degreesToRadians(60);
  const LocalTransverseMercator nav({kLatitude, 0.1});
  DeadReckoningConfig config;
  config.origin_latitude = kLatitude;
  config.max_speed = 2 * kSpeed;
  DeadReckoning track(config);
  for (int tick = 0; tick <= static_cast<int>(kSeconds * 2); ++tick) {
    const double t = 0.5 * tick;
    const Geodetic here = nav.toGeodetic({0, kSpeed * t}),
                   north = nav.toGeodetic({0.5, kSpeed * t});  // of the grid
    const double grid_north =
        std::atan2((north.longitude - here.longitude) * std::cos(kLatitude), north.latitude - here.latitude);
    track.add(AttitudeSample{.utc_ns = at(t), .heading = M_PI / 2 + grid_north, .magnetic = false});
    track.add(DepthSample{at(t), 10});
    DvlSample dvl;
    dvl.utc_ns = at(t);
    dvl.velocity = Eigen::Vector3d(kSpeed, 0, 0);
    track.add(dvl);
  }
  const auto end = track.poseAt(at(kSeconds));
  ASSERT_TRUE(end);
  EXPECT_NEAR(end->translation().y(), kSpeed * kSeconds, 0.1);
  EXPECT_NEAR(end->translation().x(), 0, 0.5);  // 54 m by true north
}

TEST(DeadReckoning, APredictedTideIsTakenOutOfTheDepth) {
  DeadReckoningConfig config = mountedConfig();
  auto samples = samplesOf(circle, config, 60);
  config.tide = Tide{1.5, 1200, 0.4, kStart};
  for (Sample& sample : samples)
    if (auto* depth = std::get_if<DepthSample>(&sample)) depth->depth += config.tide->heightAt(depth->utc_ns);
  DeadReckoning nav(config);
  feed(nav, samples);
  EXPECT_LT(worstErrorOver(nav, circle, 45, 59), 0.002);
}

TEST(DeadReckoning, SwellMovesTheTrackByMillimetresASecondAndItsPressureDepthGoesWithIt) {
  const DeadReckoningConfig config = mountedConfig();
  constexpr double kSwell = 0.4;  // amplitude [m]
  const auto swell = [](double t) { return kSwell * std::sin(2 * std::numbers::pi * t / 8); };
  auto samples = samplesOf(circle, config, 180);
  for (Sample& sample : samples)
    if (auto* depth = std::get_if<DepthSample>(&sample))
      depth->depth += swell(static_cast<double>(depth->utc_ns - kStart) * 1e-9);
  DeadReckoning nav(config);
  double before = 0, change = 0, checked = 0;
  for (const Sample& sample : samples) {
    feed(nav, sample);
    for (; nav.initialised() && at(checked) <= nav.newestUtcNs(); checked += 1) {
      const auto pose = nav.poseAt(at(checked));
      if (!pose) continue;
      const double off = pose->translation().z() - circle(checked).translation().z();
      if (checked > 90) change = std::max(change, std::abs(off - before));
      before = off;
      EXPECT_NEAR(off + nav.qualityAt(at(checked)).pressure_off, swell(checked), 0.01);
    }
  }
  EXPECT_GT(checked, 175);
  EXPECT_LT(change, 0.012);  // by pressure: 0.3 m
  EXPECT_NEAR(nav.qualityAt(nav.newestUtcNs()).pressure_sigma, kSwell / std::numbers::sqrt2, 0.05);
}

TEST(DeadReckoning, TrueHeadingsTakeNoDeclination) {
  DeadReckoningConfig config;
  config.magnetic_declination = 0.2;
  DeadReckoning nav(config);
  const Path still = [](double) { return SE3::fromEuler(0, 0, 0.5, {0, 0, 3}); };
  auto samples = samplesOf(still, DeadReckoningConfig{}, 2);
  for (Sample& sample : samples) {
    if (auto* attitude = std::get_if<AttitudeSample>(&sample)) attitude->magnetic = false;
    feed(nav, sample);
  }
  EXPECT_NEAR(nav.poseAt(at(1))->euler().z(), 0.5, 1e-9);
}

TEST(DeadReckoning, VelocityOfTheBodyIsThatOfItsOriginNotOfTheDvl) {
  const DeadReckoningConfig config = mountedConfig();
  const Path flat = [](double t) {
    return SE3::fromEuler(0, 0, 0.1 * t + std::numbers::pi / 2,
                          {10 * std::cos(0.1 * t), 10 * std::sin(0.1 * t), 20});
  };
  DeadReckoning nav(config);
  feed(nav, samplesOf(flat, config, 20));
  EXPECT_LT((nav.velocityBody() - Eigen::Vector3d(1, 0, 0)).norm(), 1e-3);
}

TEST(DeadReckoning, BeginsAboveItsFirstPoseAndNeedsAllThreeSensors) {
  const DeadReckoningConfig config = mountedConfig();
  const auto samples = samplesOf(circle, config, 3);
  DeadReckoning no_dvl(config), no_depth(config), no_attitude(config), all(config);
  for (const Sample& sample : samples) {
    if (!std::holds_alternative<DvlSample>(sample)) feed(no_dvl, sample);
    if (!std::holds_alternative<DepthSample>(sample)) feed(no_depth, sample);
    if (!std::holds_alternative<AttitudeSample>(sample)) feed(no_attitude, sample);
    feed(all, sample);
  }
  EXPECT_FALSE(no_dvl.initialised());
  EXPECT_FALSE(no_depth.initialised());
  EXPECT_FALSE(no_attitude.initialised());
  EXPECT_FALSE(no_dvl.poseAt(at(1)));
  EXPECT_EQ(no_dvl.newestUtcNs(), 0);
  EXPECT_EQ(no_dvl.velocityBody(), Eigen::Vector3d::Zero());
  ASSERT_TRUE(all.initialised());
  const Eigen::Vector3d first = all.poseAt(all.oldestUtcNs())->translation();
  EXPECT_NEAR(first.head<2>().norm(), 0, 1e-12);
  EXPECT_NEAR(first.z(), circle(0.037).translation().z(), 0.01);
}

TEST(DeadReckoning, PosesThatWereFinalNeverChangeAfterwards) {
  const DeadReckoningConfig config = mountedConfig();
  DeadReckoning nav(config);
  std::int64_t asked = 0;
  SE3 then;
  for (const Sample& sample : samplesOf(circle, config, 10)) {
    feed(nav, sample);
    if (asked != 0) {
      const SE3 now = *nav.poseAt(asked);
      ASSERT_EQ(now.translation(), then.translation());
      ASSERT_EQ(now.rotation().coeffs(), then.rotation().coeffs());
    }
    if (nav.initialised()) {
      asked = nav.newestUtcNs() - 1'000'000;
      if (asked < nav.oldestUtcNs()) asked = nav.oldestUtcNs();
      then = *nav.poseAt(asked);
    }
  }
  EXPECT_NE(asked, 0);
}

TEST(DeadReckoning, KeepsTwentySecondsAndExtrapolatesOne) {
  const DeadReckoningConfig config = mountedConfig();
  DeadReckoning nav(config);
  feed(nav, samplesOf(circle, config, 120, {7, 50, 10}));
  const std::int64_t newest = nav.newestUtcNs();
  EXPECT_TRUE(nav.poseAt(newest - 15'000'000'000));
  EXPECT_FALSE(nav.poseAt(newest - 110'000'000'000));
  EXPECT_FALSE(nav.poseAt(newest + 1'000'000'001));
  const auto beyond = nav.poseAt(newest + 200'000'000);
  ASSERT_TRUE(beyond);
  EXPECT_LT(positionError(*beyond, circle, static_cast<double>(newest + 200'000'000 - kStart) * 1e-9), 0.05);
}

TEST(DeadReckoning, AltitudeIsGivenOnlyWhileItIsFresh) {
  const DeadReckoningConfig config = mountedConfig();
  DeadReckoning nav(config);
  EXPECT_FALSE(nav.altitude());
  DvlSample ensemble;
  ensemble.utc_ns = at(0);
  ensemble.sound_speed = 1530;
  ensemble.range = {2.0, 2.2, 1.9, 2.1};
  nav.add(ensemble);
  EXPECT_NEAR(*nav.altitude(), 2.05, 1e-12);
  nav.add(depthAt(circle, config, 1.9));
  EXPECT_TRUE(nav.altitude());
  nav.add(depthAt(circle, config, 2.1));
  EXPECT_FALSE(nav.altitude());
}

TEST(DeadReckoning, AllocatesNothingAfterConstruction) {
  const DeadReckoningConfig config = mountedConfig();
  const auto samples = samplesOf(circle, config, 60);
  DeadReckoning nav(config);
  const fathom::test::ThreadCost before = fathom::test::threadCost();
  for (const Sample& sample : samples) {
    feed(nav, sample);
    static_cast<void>(nav.poseAt(nav.newestUtcNs()));
    static_cast<void>(nav.velocityBody());
  }
  const fathom::test::ThreadCost cost = fathom::test::threadCost() - before;
  EXPECT_TRUE(nav.initialised());
  EXPECT_EQ(cost.heap_calls, 0u);
}

}  // namespace
}  // namespace fathom::nav
