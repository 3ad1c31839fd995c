#include "sim/sensors/sensors.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/world/sim_scenes.hpp"

namespace fathom::sim {
namespace {

TEST_F(SensorTest, DvlVelocityHasTheNoiseScaleAndSoundSpeedErrorOfItsSpecification) {
  SensorsConfig config;
  const SensorWorld w = world();
  const auto samples = sampled<DvlSample>(simulateDvl, config);
  // Least squares for the one factor between measured and true speeds, then the rest is noise.
  double num = 0, den = 0;
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> pairs;
  int absent = 0;
  for (const DvlSample& dvl : samples) {
    if (!dvl.velocity) {
      ++absent;
      continue;
    }
    const double t = timeOf(dvl.utc_ns), step = 1e-3;
    if (t < step || t > trajectory.duration() - step) continue;
    // Independent of the simulator's own formula: the difference of the instrument's positions.
    const SE3 at = trajectory.poseAt(t) * w.T_body_dvl;
    const Eigen::Vector3d moved = ((trajectory.poseAt(t + step) * w.T_body_dvl).translation() -
                                   (trajectory.poseAt(t - step) * w.T_body_dvl).translation()) /
                                  (2 * step);
    const Eigen::Vector3d truth = at.rotation().conjugate() * moved;
    pairs.emplace_back(*dvl.velocity, truth);
    num += dvl.velocity->dot(truth);
    den += truth.squaredNorm();
  }
  const double factor = num / den;
  const double sound = config.dvl.assumed_sound_speed_mps /
                       soundSpeed(config.water.temperature_c, config.water.salinity_psu, 10.0);
  EXPECT_NEAR(factor / sound, 1.0, config.dvl.scale_error + 0.001);
  Statistics noise;
  for (const auto& [measured, truth] : pairs)
    for (int i = 0; i < 3; ++i) noise.add(measured[i] - factor * truth[i]);
  EXPECT_NEAR(noise.sigma(), 0.002, 0.0003);
  const double lost = absent / static_cast<double>(samples.size());
  EXPECT_GT(lost, 0.002);
  EXPECT_LT(lost, 0.06);
}

TEST_F(SensorTest, DvlRangesAndAltitudeAreThoseOfFourBeamsOnTheSeafloor) {
  SensorsConfig config;
  config.dvl.assumed_sound_speed_mps =
      soundSpeed(config.water.temperature_c, config.water.salinity_psu, 10.0);
  const SensorWorld w = world();
  const auto samples = sampled<DvlSample>(simulateDvl, config);
  int checked = 0;
  for (const DvlSample& dvl : samples) {
    if (!dvl.altitude) continue;
    const SE3 pose = trajectory.poseAt(timeOf(dvl.utc_ns)) * w.T_body_dvl;
    EXPECT_NEAR(*dvl.altitude, kSeafloor - pose.translation().z(), 0.06);
    // With the instrument level every beam's vertical projection is the altitude; with a tilt they straddle
    // it.
    double lowest = 1e9, highest = 0;
    for (const auto& range : dvl.range) {
      ASSERT_TRUE(range.has_value());
      lowest = std::min(lowest, *range);
      highest = std::max(highest, *range);
    }
    EXPECT_LE(lowest, *dvl.altitude + 0.05);
    EXPECT_GE(highest, *dvl.altitude - 0.05);
    ++checked;
  }
  EXPECT_GT(checked, 500);
}

TEST_F(SensorTest, DvlHasNoBottomLockBeyondItsRange) {
  SensorsConfig config;
  config.dvl.max_range_m = 5.0;
  const auto samples = sampled<DvlSample>(simulateDvl, config);
  for (const DvlSample& dvl : samples) {
    const double depth = trajectory.poseAt(timeOf(dvl.utc_ns)).translation().z();
    if (kSeafloor - depth > 6.0) {
      EXPECT_FALSE(dvl.velocity.has_value());
    }
  }
}

TEST_F(SensorTest, ASilentDvlGivesNothingAndAStuckOneItsLastGoodEnsemble) {
  SensorsConfig config;
  const auto healthy = sampled<DvlSample>(simulateDvl, config);
  config.dvl.outages = {{60, 90}};
  config.dvl.stuck = {{120, 130}};
  const auto faulty = sampled<DvlSample>(simulateDvl, config);
  EXPECT_EQ(healthy.size() - faulty.size(), static_cast<std::size_t>(30 * config.dvl.rate_hz));
  std::size_t k = 0;
  const DvlSample* before = nullptr;
  for (const DvlSample& dvl : faulty) {
    const double t = timeOf(dvl.utc_ns);
    EXPECT_FALSE(t >= 60 && t < 90);
    while (healthy[k].utc_ns < dvl.utc_ns) ++k;
    const auto& good = healthy[k];
    if (t >= 120 && t < 130) {
      ASSERT_NE(before, nullptr);
      EXPECT_EQ(dvl.velocity, before->velocity);
      EXPECT_EQ(dvl.altitude, before->altitude);
    } else {
      // The other ensembles are as they would have been.
      EXPECT_EQ(dvl.velocity, good.velocity);
      if (dvl.velocity) before = &dvl;
    }
  }
}

TEST_F(SensorTest, DepthFollowsTheSensorAndTheTide) {
  SensorsConfig config;
  config.tide.amplitude_m = 0.5;
  config.tide.period_s = 600;
  const SensorWorld w = world();
  const auto samples = sampled<DepthSample>(simulateDepth, config);
  Statistics error;
  for (const DepthSample& d : samples) {
    const double t = timeOf(d.utc_ns);
    const double truth = (trajectory.poseAt(t) * w.T_body_depth).translation().z() +
                         0.5 * std::sin(2 * std::numbers::pi * t / 600);
    error.add(d.depth - truth);
  }
  EXPECT_LT(std::abs(error.mean()), 5 * config.depth.scale_error * kSeafloor);
  EXPECT_NEAR(error.sigma(), config.depth.sigma_m, 0.2 * config.depth.sigma_m);
}

// k of omega^2 = g k tanh(k h) by bisection.
double waveNumber(double rate, double depth) {
  double low = 0, high = 10;
  for (int i = 0; i < 60; ++i) {
    const double k = 0.5 * (low + high);
    (9.81 * k * std::tanh(k * depth) < rate * rate ? low : high) = k;
  }
  return low;
}

TEST_F(SensorTest, SwellHasItsHeightAtTheSurfaceAndWhatDepthLeavesOfItBelow) {
  const Waves waves = world().waves({.height_m = 2, .period_s = 8});
  Statistics surface, below;
  constexpr double kDepth = 10;
  for (double t = 0; t < 3600; t += 0.5) {
    surface.add(waves.heightAt({3, 4}, t));
    below.add(waves.pressureAt({3, 4, kDepth}, kSeafloor, t));
  }
  EXPECT_NEAR(surface.sigma(), 0.5, 0.02);
  EXPECT_NEAR(surface.mean(), 0, 0.01);
  // Of the peak's waves more is left than of the mean, of waves of the mean period less.
  const auto left = [](double period) {
    const double k = waveNumber(2 * std::numbers::pi / period, kSeafloor);
    return std::cosh(k * (kSeafloor - kDepth)) / std::cosh(k * kSeafloor);
  };
  EXPECT_LT(below.sigma() / surface.sigma(), left(8));
  EXPECT_GT(below.sigma() / surface.sigma(), left(6.6));
  // A crest every peak period or a little less.
  int rises = 0;
  for (double t = 0; t < 3600; t += 0.1)
    rises += waves.heightAt({3, 4}, t) < 0 && waves.heightAt({3, 4}, t + 0.1) >= 0 ? 1 : 0;
  EXPECT_NEAR(3600.0 / rises, 6.6, 0.8);
}

TEST_F(SensorTest, SwellMovesDepthAndGpsAndNothingElse) {
  SensorsConfig calm, rough;
  rough.waves.height_m = 1;
  const auto of = [&](const SensorsConfig& config, auto simulate) {
    LoggedSamples samples;
    simulate(world(), config, samples);
    return samples;
  };
  const LoggedSamples depth = of(calm, simulateDepth), in_swell = of(rough, simulateDepth);
  ASSERT_EQ(depth.size(), in_swell.size());
  Statistics down;
  for (std::size_t k = 0; k < depth.size(); ++k)
    down.add(std::get<DepthSample>(in_swell[k].sample).depth - std::get<DepthSample>(depth[k].sample).depth);
  const Waves waves = world().waves(rough.waves);
  Statistics expected;
  for (double t = 0; t < trajectory.duration(); t += 0.2)
    expected.add(waves.pressureAt((trajectory.poseAt(t) * world().T_body_depth).translation(), kSeafloor, t));
  EXPECT_NEAR(down.sigma(), expected.sigma(), 0.005);
  EXPECT_GT(down.sigma(), 0.1);
  const LoggedSamples gps = of(calm, simulateGps), afloat = of(rough, simulateGps);
  const LocalTransverseMercator mercator(world().origin);
  Statistics east;
  for (std::size_t k = 0; k < gps.size(); ++k) {
    const auto &a = std::get<GpsFix>(gps[k].sample), &b = std::get<GpsFix>(afloat[k].sample);
    east.add((mercator.toLocal({b.latitude, b.longitude}) - mercator.toLocal({a.latitude, a.longitude})).y());
  }
  EXPECT_NEAR(east.sigma(), 0.25 / std::tanh(waveNumber(2 * std::numbers::pi / 8, kSeafloor) * kSeafloor),
              0.12);
}

TEST_F(SensorTest, UsblFixesAreLateAccurateAndSometimesWildlyWrong) {
  UsblConfig config;
  config.period_s = 0.5;
  const SensorWorld w = world();
  const auto samples = sampled<UsblFix>(simulateUsbl, config);
  const LocalTransverseMercator mercator(w.origin);
  std::vector<double> errors;
  int wild = 0;
  for (const UsblFix& fix : samples) {
    EXPECT_GT(fix.arrival_utc_ns - fix.utc_ns, std::int64_t{1'000'000'000});
    const Eigen::Vector3d truth = (trajectory.poseAt(timeOf(fix.utc_ns)) * w.T_body_usbl).translation();
    const Eigen::Vector2d error = mercator.toLocal({fix.latitude, fix.longitude}) - truth.head<2>();
    error.norm() > 3.0 ? void(++wild) : errors.push_back(error.squaredNorm());
  }
  double sum = 0;
  for (const double e : errors) sum += e;
  // 0.2 m of range and 0.25 degrees of bearing at about 30 m: 0.13 m; elevation adds a little.
  const double rms = std::sqrt(sum / static_cast<double>(errors.size()));
  EXPECT_GT(rms, 0.18);
  EXPECT_LT(rms, 0.32);
  EXPECT_NEAR(wild / static_cast<double>(samples.size()), config.outlier_probability, 0.025);
  // What a fix states is the error of either component.
  EXPECT_NEAR(samples.front().sigma_horizontal, rms / std::numbers::sqrt2, 0.06);
}

TEST_F(SensorTest, GpsIsThereOnlyAtTheSurface) {
  const auto samples = sampled<GpsFix>(simulateGps, SensorsConfig());
  int before = 0, after = 0;
  for (const GpsFix& fix : samples) {
    const double t = timeOf(fix.utc_ns);
    EXPECT_TRUE(t < trajectory.diveBegin() || t >= trajectory.surfaced());
    ++(t < trajectory.diveBegin() ? before : after);
  }
  EXPECT_GE(before, 15);
  EXPECT_GE(after, 15);
}

TEST_F(SensorTest, CameraClocksRunOffByTheirOffsetAndDrift) {
  const CameraClockConfig config;
  const auto exposures = simulateExposures(world(), config);
  ASSERT_GT(exposures.size(), 200u);
  for (const Exposure& e : exposures) {
    EXPECT_NEAR(timeOf(e.left_stamp_ns) - e.time_s, 0.012 + 50e-6 * e.time_s, 2e-8);
    EXPECT_NEAR(timeOf(e.right_stamp_ns) - e.time_s, 0.009 - 50e-6 * e.time_s, 2e-8);
    EXPECT_GE(e.time_s, trajectory.surveyBegin());
    EXPECT_LT(e.time_s, trajectory.surveyEnd());
  }
}

TEST_F(SensorTest, TheLogIsInTheOrderOfArrivalAndEverySensorIsInIt) {
  SensorsConfig config;
  config.gyro.rate_hz = 10;
  const auto samples = simulateSensors(world(), config, simulateExposures(world(), config.cameras));
  std::array<int, std::variant_size_v<SensorSample>> counts{};
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (i > 0) {
      ASSERT_GE(samples[i].arrival_utc_ns, samples[i - 1].arrival_utc_ns);
    }
    ++counts[samples[i].sample.index()];
  }
  for (std::size_t kind = 0; kind < counts.size(); ++kind) {
    // Progress comes from mission control, which is no sensor.
    if (kind != SensorSample(MissionProgressSample{}).index()) {
      EXPECT_GT(counts[kind], 5) << kind;
    }
  }
}

TEST_F(SensorTest, OneSensorsRateDoesNotChangeAnothersNumbers) {
  SensorsConfig config;
  const auto a = sampled<DepthSample>(simulateDepth, config);
  config.dvl.rate_hz = 9;
  (void)sampled<DvlSample>(simulateDvl, config);
  const auto b = sampled<DepthSample>(simulateDepth, config);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_EQ(a[i].depth, b[i].depth);
  const auto c = sampled<DepthSample>(simulateDepth, config, 8);
  EXPECT_NE(a[3].depth, c[3].depth);
}

TEST_F(SensorTest, ABatteryLosesTheEnergyThatItGives) {
  SensorsConfig config;
  config.battery.rate_hz = 1;
  const auto samples = sampled<BatterySample>(simulateBattery, config.battery);
  ASSERT_GT(samples.size(), 100U);
  double given_wh = 0, last_charge = config.battery.start_charge;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& b = samples[i];
    ASSERT_TRUE(b.voltage && b.current && b.charge);
    EXPECT_LE(*b.charge, last_charge);
    last_charge = *b.charge;
    // What the cells give is what leaves the terminals and what warms the inside.
    const double open_v = *b.voltage + *b.current * config.battery.resistance_ohm;
    EXPECT_NEAR(open_v, 42.0 + 8.4 * *b.charge, 1e-9);
    if (i > 0) given_wh += open_v * *b.current / 3600;
  }
  EXPECT_NEAR((config.battery.start_charge - last_charge) * config.battery.capacity_wh, given_wh, 1e-6);
  // The electronics alone take most of it.
  const double hours = trajectory.duration() / 3600;
  EXPECT_GT(given_wh, 150 * hours * 0.99);
  EXPECT_LT(given_wh, 300 * hours);
}

TEST_F(SensorTest, AnEmptyBatteryStaysEmpty) {
  SensorsConfig config;
  config.battery.capacity_wh = 1;
  const auto samples = sampled<BatterySample>(simulateBattery, config.battery);
  EXPECT_EQ(samples.back().charge, 0.0);
}

TEST(WaterProperties, AgreeWithThePublishedCheckValues) {
  // Mackenzie (1981): 1550.744 m/s at 25 deg C, 35 psu, 1000 m.
  EXPECT_NEAR(soundSpeed(25, 35, 1000), 1550.744, 0.001);
  // UNESCO technical paper 44 (1983): water that conducts as the standard at 15 deg C has 35 psu.
  EXPECT_NEAR(practicalSalinity(15, 4.2914), 35.0, 1e-4);
  for (const double t : {5.0, 15.0, 24.0})
    EXPECT_NEAR(practicalSalinity(t, conductivity(t, 33.3)), 33.3, 1e-9);
  // 35 psu at 25 deg C conducts 5.3 S/m (Poisson 1980: 53.03 mS/cm).
  EXPECT_NEAR(conductivity(25, 35), 5.303, 0.005);
}

}  // namespace
}  // namespace fathom::sim
