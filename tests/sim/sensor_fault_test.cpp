// Faults and errors of the sensors beyond their data sheets.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "realtime/base/units.hpp"
#include "tests/world/sim_scenes.hpp"

namespace fathom::sim {
namespace {

class SensorFault : public SensorTest {
 protected:
  std::vector<DvlSample> dvl(const SimulatedDvlConfig& config) const {
    SensorsConfig sensors;
    sensors.dvl = config;
    return sampled<DvlSample>(simulateDvl, sensors);
  }
  std::vector<AttitudeSample> compass(const CompassConfig& config) const {
    return sampled<AttitudeSample>(simulateCompass, config);
  }
  std::vector<UsblFix> usbl(const UsblConfig& config) const { return sampled<UsblFix>(simulateUsbl, config); }
  Eigen::Vector2d placeOf(const UsblFix& fix) const {
    return LocalTransverseMercator(world().origin).toLocal({fix.latitude, fix.longitude});
  }
  Eigen::Vector2d truePlace(const UsblFix& fix) const {
    return (trajectory.poseAt(timeOf(fix.utc_ns)) * world().T_body_usbl).translation().head<2>();
  }
};

TEST_F(SensorFault, ADeadBeamLeavesThreeAndTheVelocity) {
  SimulatedDvlConfig config;
  config.dropout_probability = 0;
  const auto healthy = dvl(config);
  config.dead_beam = 3;
  const auto faulty = dvl(config);
  ASSERT_EQ(healthy.size(), faulty.size());
  for (std::size_t k = 0; k < healthy.size(); ++k) {
    EXPECT_FALSE(faulty[k].range[2]);
    EXPECT_EQ(faulty[k].range[0], healthy[k].range[0]);
    EXPECT_EQ(faulty[k].velocity.has_value(), healthy[k].velocity.has_value());
  }
}

TEST_F(SensorFault, FishShortenBeamsByThemselves) {
  SimulatedDvlConfig config;
  const auto healthy = dvl(config);
  config.fish_probability = 0.1;
  const auto faulty = dvl(config);
  int shorter = 0, all = 0;
  for (std::size_t k = 0; k < healthy.size(); ++k)
    for (std::size_t b = 0; b < 4; ++b) {
      if (!healthy[k].range[b]) continue;
      ++all;
      shorter += *faulty[k].range[b] < 0.98 * *healthy[k].range[b] ? 1 : 0;
      EXPECT_LE(*faulty[k].range[b], *healthy[k].range[b] + 1e-9);
    }
  EXPECT_NEAR(static_cast<double>(shorter) / all, 0.1, 0.015);
}

TEST_F(SensorFault, AFalseBottomIsAtHalfTheRangeAndDriftsWithTheWater) {
  SimulatedDvlConfig config;
  config.dropout_probability = 0;
  const auto healthy = dvl(config);
  config.current_north_mps = 0.3;
  config.false_bottom = {{100, 140}};
  const auto faulty = dvl(config);
  int seen = 0;
  for (std::size_t k = 0; k < healthy.size(); ++k) {
    const double t = timeOf(healthy[k].utc_ns);
    if (!healthy[k].velocity || !healthy[k].altitude) continue;
    const SensorWorld w = world();
    const Eigen::Matrix3d R_dvl_nav =
        (trajectory.poseAt(t) * w.T_body_dvl).rotation().conjugate().toRotationMatrix();
    const Eigen::Vector3d off = *healthy[k].velocity - *faulty[k].velocity;
    const bool fault = t >= 100 && t < 140;
    EXPECT_LT((off - (fault ? 0.3 : 0.0) * R_dvl_nav.col(0)).norm(), 0.008)
        << t;  // the instrument's speed of sound
    EXPECT_NEAR(*faulty[k].altitude / *healthy[k].altitude, fault ? 0.5 : 1.0, 0.02);
    seen += fault ? 1 : 0;
  }
  EXPECT_GT(seen, 150);
}

TEST_F(SensorFault, BubblesAndSteepGroundTakeTheLock) {
  SimulatedDvlConfig config;
  config.dropout_probability = 0;
  config.bubble_depth_m = 5;
  for (const DvlSample& s : dvl(config))
    if ((trajectory.poseAt(timeOf(s.utc_ns)) * world().T_body_dvl).translation().z() < 5) {
      EXPECT_FALSE(s.velocity);
    }
  config.bubble_depth_m = 0;
  config.steepest = 31 * kRadiansPerDegree;  // beams stand 30 degrees off; the hull rolls
  const auto lost = dvl(config);
  const auto beams = [](const std::vector<DvlSample>& all) {
    int n = 0;
    for (const DvlSample& s : all)
      for (const auto& range : s.range) n += range ? 1 : 0;
    return n;
  };
  config.steepest = 60 * kRadiansPerDegree;
  const auto kept = dvl(config);
  EXPECT_LT(beams(lost), 0.9 * beams(kept));
  config.steepest = 90 * kRadiansPerDegree;
  EXPECT_EQ(beams(dvl(config)), beams(kept));
}

TEST_F(SensorFault, DvlNoiseGrowsWithTheAltitude) {
  SimulatedDvlConfig config;
  config.dropout_probability = 0;
  config.velocity_sigma_mps = 0;
  const auto exact = dvl(config);
  config.velocity_sigma_per_m = 0.002;
  const auto noisy = dvl(config);
  Statistics low;
  for (std::size_t k = 0; k < exact.size(); ++k)
    if (exact[k].velocity) low.add((noisy[k].velocity->x() - exact[k].velocity->x()) / *exact[k].altitude);
  EXPECT_NEAR(low.sigma(), 0.002, 0.0002);
}

TEST_F(SensorFault, SoftIronTurnsTwiceOverACircle) {
  CompassConfig config;
  const auto hard = compass(config);
  config.soft_iron = 5 * kRadiansPerDegree;
  const auto soft = compass(config);
  // Added to the heading: A sin(2 h + phase), whatever the phase.
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d rhs = Eigen::Vector2d::Zero();
  double rest = 0;
  std::vector<std::pair<Eigen::Vector2d, double>> rows;
  for (std::size_t k = 0; k < hard.size(); ++k) {
    const double heading = (trajectory.poseAt(timeOf(hard[k].utc_ns)) * world().T_body_compass).euler().z();
    rows.emplace_back(Eigen::Vector2d(std::sin(2 * heading), std::cos(2 * heading)),
                      wrapAngle(soft[k].heading - hard[k].heading));
    normal += rows.back().first * rows.back().first.transpose();
    rhs += rows.back().second * rows.back().first;
  }
  const Eigen::Vector2d found = normal.inverse() * rhs;
  for (const auto& [row, turned] : rows) rest = std::max(rest, std::abs(row.dot(found) - turned));
  EXPECT_NEAR(found.norm(), 5 * kRadiansPerDegree, 1e-6);
  EXPECT_LT(rest, 1e-6);
}

TEST_F(SensorFault, ACompassThatLagsShowsWhereTheHullPointedBefore) {
  CompassConfig config;
  config.deviation = config.drift_sigma = config.heading_sigma = config.tilt_sigma = config.tilt_bias_sigma =
      0;
  config.lag_s = 0.5;
  double now = 0, before = 0;
  for (const AttitudeSample& s : compass(config)) {
    const double t = timeOf(s.utc_ns);
    if (t < trajectory.surveyBegin() || t > trajectory.surveyEnd()) continue;
    const auto off = [&](double at) {
      const double heading = (trajectory.poseAt(at) * world().T_body_compass).euler().z();
      return wrapAngle(s.heading + world().magnetic_declination - heading);
    };
    now += off(t) * off(t), before += off(t - 0.5) * off(t - 0.5);
  }
  EXPECT_LT(before, 0.15 * now);
}

TEST_F(SensorFault, AccelerationIsTakenForTilt) {
  CompassConfig config;
  const auto still = compass(config);
  config.acceleration_share = 1;
  const auto fooled = compass(config);
  double largest = 0;
  for (std::size_t k = 0; k < still.size(); ++k) {
    const double t = timeOf(still[k].utc_ns);
    const Trajectory::State a = trajectory.at(t - 0.1), b = trajectory.at(t + 0.1);
    const Eigen::Vector3d acceleration =
        trajectory.poseAt(t).rotation().conjugate() * ((b.velocity_nav - a.velocity_nav) / 0.2);
    EXPECT_NEAR(fooled[k].pitch - still[k].pitch, acceleration.x() / 9.81, 1e-9);
    EXPECT_NEAR(fooled[k].roll - still[k].roll, -acceleration.y() / 9.81, 1e-9);
    largest = std::max(largest, std::abs(fooled[k].pitch - still[k].pitch));
  }
  EXPECT_GT(largest, 0.5 * kRadiansPerDegree);
}

TEST_F(SensorFault, UsblErrorsOfTheShipAndTheWater) {
  UsblConfig exact;
  exact.range_sigma_m = exact.angle_sigma = exact.outlier_probability = 0;
  for (const UsblFix& fix : usbl(exact)) EXPECT_LT((placeOf(fix) - truePlace(fix)).norm(), 0.01);
  UsblConfig sailing = exact;
  sailing.ship_circle_m = 40;
  for (const UsblFix& fix : usbl(sailing))
    EXPECT_LT((placeOf(fix) - truePlace(fix)).norm(), 0.01) << "the ship knows where it is";
  UsblConfig multipath = exact;
  multipath.multipath = {{{60, 120}, 7, -3}};
  multipath.wrong_targets = {{{130, 180}, 55, 66}};
  int echoes = 0, wrong = 0;
  for (const UsblFix& fix : usbl(multipath)) {
    const double t = timeOf(fix.utc_ns);
    if (t >= 60 && t < 120) {
      EXPECT_LT((placeOf(fix) - truePlace(fix) - Eigen::Vector2d(7, -3)).norm(), 0.01);
      ++echoes;
    } else if (t >= 130 && t < 180) {
      EXPECT_LT((placeOf(fix) - Eigen::Vector2d(55, 66)).norm(), 0.01);
      ++wrong;
    } else {
      EXPECT_LT((placeOf(fix) - truePlace(fix)).norm(), 0.01);
    }
  }
  EXPECT_GE(echoes, 5);
  EXPECT_GE(wrong, 4);
  UsblConfig bent = exact, turning = exact, far = exact;
  bent.bending = 2 * kRadiansPerDegree;
  turning.heading_wobble = 3 * kRadiansPerDegree;
  far.range_sigma_per_m = 0.02;
  Statistics bearing, range;
  const Eigen::Vector2d ship(exact.ship_north_m, exact.ship_east_m);
  for (const UsblFix& fix : usbl(bent)) {
    if (trajectory.poseAt(timeOf(fix.utc_ns)).translation().z() < 6) continue;
    EXPECT_LT((placeOf(fix) - ship).norm(), (truePlace(fix) - ship).norm()) << "it seems deeper and nearer";
  }
  for (const UsblFix& fix : usbl(turning)) {
    const Eigen::Vector2d seen = placeOf(fix) - ship, truly = truePlace(fix) - ship;
    bearing.add(wrapAngle(std::atan2(seen.y(), seen.x()) - std::atan2(truly.y(), truly.x())));
    EXPECT_NEAR(seen.norm(), truly.norm(), 0.01);
  }
  EXPECT_NEAR(std::hypot(bearing.sigma(), bearing.mean()), 3 * kRadiansPerDegree, 2 * kRadiansPerDegree);
  for (const UsblFix& fix : usbl(far))
    range.add(((placeOf(fix) - ship).norm() / (truePlace(fix) - ship).norm() - 1));
  EXPECT_NEAR(range.sigma(), 0.02, 0.01);
}

TEST_F(SensorFault, SamplesComeLateInBatchesWithStampsThatJitter) {
  SensorsConfig config;
  const auto all = [&] { return simulateSensors(world(), config, {}); };
  const LoggedSamples prompt = all();
  config.arrival.batch_s = 0.5;
  for (const io::LoggedSample& s : all())
    if (std::holds_alternative<DvlSample>(s.sample) || std::holds_alternative<DepthSample>(s.sample)) {
      EXPECT_EQ(s.arrival_utc_ns % 500'000'000, 0);
    }
  config.arrival = {.jitter_s = 0.1, .batch_s = 0, .stamp_jitter_s = 0.02};
  Statistics late, stamp;
  std::int64_t before = 0;
  std::vector<std::int64_t> stamps;
  for (const io::LoggedSample& s : all()) {
    EXPECT_GE(s.arrival_utc_ns, before);
    before = s.arrival_utc_ns;
    const auto* depth = std::get_if<DepthSample>(&s.sample);
    if (depth == nullptr) continue;
    const double interval = 1 / config.depth.rate_hz;
    const double t = timeOf(depth->utc_ns), was = std::round(t / interval) * interval;
    stamp.add(t - was);
    late.add(timeOf(s.arrival_utc_ns) - was - config.depth.latency_s);
  }
  EXPECT_NEAR(stamp.sigma(), 0.02, 0.004);
  EXPECT_NEAR(late.mean(), 0.1, 0.02);
}

TEST_F(SensorFault, UsblBearingHasItsNoise) {
  UsblConfig config;
  config.range_sigma_m = config.outlier_probability = 0;
  config.angle_sigma = 1 * kRadiansPerDegree;
  config.period_s = 1;
  Statistics bearing;
  const Eigen::Vector2d ship(config.ship_north_m, config.ship_east_m);
  for (const UsblFix& fix : usbl(config)) {
    const Eigen::Vector2d seen = placeOf(fix) - ship, truly = truePlace(fix) - ship;
    bearing.add(wrapAngle(std::atan2(seen.y(), seen.x()) - std::atan2(truly.y(), truly.x())));
  }
  EXPECT_NEAR(bearing.sigma(), 1 * kRadiansPerDegree, 0.15 * kRadiansPerDegree);
  EXPECT_NEAR(bearing.mean(), 0, 0.25 * kRadiansPerDegree);
}

TEST_F(SensorFault, GpsIsWhereTheVehicleIsInTheMean) {
  SensorsConfig sensors;
  sensors.gps.drift_sigma_m = 0;
  sensors.gps.sigma_m = 0.4;
  sensors.gps.rate_hz = 10;
  const LocalTransverseMercator mercator(world().origin);
  Statistics north, east;
  for (const GpsFix& fix : sampled<GpsFix>(simulateGps, sensors)) {
    const Eigen::Vector2d off = mercator.toLocal({fix.latitude, fix.longitude}) -
                                trajectory.poseAt(timeOf(fix.utc_ns)).translation().head<2>();
    north.add(off.x()), east.add(off.y());
  }
  EXPECT_NEAR(north.mean(), 0, 0.08);
  EXPECT_NEAR(east.mean(), 0, 0.08);
  EXPECT_NEAR(north.sigma(), 0.4, 0.06);
}

TEST_F(SensorFault, DvlScaleIsDrawnForEachDiveAndSoundSetsSpeedsAndRanges) {
  SensorsConfig sensors;
  sensors.dvl.velocity_sigma_mps = sensors.dvl.range_sigma_m = sensors.dvl.dropout_probability = 0;
  const auto middle = [&](std::uint64_t seed) { return sampled<DvlSample>(simulateDvl, sensors, seed)[600]; };
  const DvlSample first = middle(1);
  Statistics scale;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    const DvlSample s = middle(seed);
    scale.add(s.velocity->norm() / first.velocity->norm());
    EXPECT_EQ(s.range, first.range) << "ranges have no scale error";
  }
  EXPECT_NEAR(scale.sigma(), sensors.dvl.scale_error / std::sqrt(3.0), 0.3e-3);
  sensors.dvl.assumed_sound_speed_mps *= 1.1;
  const DvlSample other = middle(1);
  EXPECT_NEAR(other.velocity->norm() / first.velocity->norm(), 1.1, 1e-9);
  for (std::size_t b = 0; b < 4; ++b) EXPECT_NEAR(*other.range[b] / *first.range[b], 1.1, 1e-9);
}

}  // namespace
}  // namespace fathom::sim
