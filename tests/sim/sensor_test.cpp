#include "sim/sensors/sensors.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/sensors/water_properties.hpp"
#include "sim/vehicle/vehicle.hpp"

namespace fathom::sim {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kSeafloor = 12.0;  // depth of the flat test seafloor [m]

std::optional<double> castFlat(const Eigen::Vector3d& from, const Eigen::Vector3d& direction) {
  if (direction.z() <= 0) return std::nullopt;
  return (kSeafloor - from.z()) / direction.z();
}

// A dive of a few minutes over a flat seafloor.
class SensorTest : public ::testing::Test {
 protected:
  static SurveyPlan plan() {
    SurveyPlan p;
    p.lines = 6;
    p.line_length = 12;
    p.cross_lines = 2;
    return p;
  }
  const Trajectory trajectory = simulateVehicle(
      plan(), VehicleConfig(), [](double, double) { return kSeafloor; }, 2);
  SensorWorld world(std::uint64_t seed = 7) const {
    return {trajectory,
            castFlat,
            {-0.4089, 2.6519},
            1772330400000000000,
            0.18,
            SE3::fromEuler(0.01, -0.02, 0.03, {-0.35, 0.0, 0.22}),
            SE3::fromEuler(0, 0, 0, {0.1, 0.0, -0.4}),
            SE3::fromEuler(0, 0, 0, {0.2, 0.1, -0.1}),
            SE3::fromEuler(0.003, 0.005, -0.009, {0.6, 0, -0.2}),
            seed};
  }
  double timeOf(std::int64_t utc_ns) const {
    return static_cast<double>(utc_ns - 1772330400000000000) * 1e-9;
  }
};

struct Statistics {
  double sum = 0, squares = 0;
  int count = 0;
  void add(double v) {
    sum += v;
    squares += v * v;
    ++count;
  }
  double mean() const { return sum / count; }
  double sigma() const { return std::sqrt(squares / count - mean() * mean()); }
};

TEST_F(SensorTest, DvlVelocityHasTheNoiseScaleAndSoundSpeedErrorOfItsSpecification) {
  SensorsConfig config;
  LoggedSamples samples;
  const SensorWorld w = world();
  simulateDvl(w, config, samples);
  // Least squares for the one factor between measured and true speeds, then the rest is noise.
  double num = 0, den = 0;
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> pairs;
  int absent = 0;
  for (const auto& s : samples) {
    const auto& dvl = std::get<DvlSample>(s.sample);
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
  LoggedSamples samples;
  const SensorWorld w = world();
  simulateDvl(w, config, samples);
  int checked = 0;
  for (const auto& s : samples) {
    const auto& dvl = std::get<DvlSample>(s.sample);
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
  LoggedSamples samples;
  simulateDvl(world(), config, samples);
  for (const auto& s : samples) {
    const auto& dvl = std::get<DvlSample>(s.sample);
    const double depth = trajectory.poseAt(timeOf(dvl.utc_ns)).translation().z();
    if (kSeafloor - depth > 6.0) {
      EXPECT_FALSE(dvl.velocity.has_value());
    }
  }
}

TEST_F(SensorTest, ASilentDvlGivesNothingAndAStuckOneItsLastGoodEnsemble) {
  SensorsConfig config;
  LoggedSamples healthy, faulty;
  const SensorWorld w = world();
  simulateDvl(w, config, healthy);
  config.dvl.outages = {{60, 90}};
  config.dvl.stuck = {{120, 130}};
  simulateDvl(w, config, faulty);
  EXPECT_EQ(healthy.size() - faulty.size(), static_cast<std::size_t>(30 * config.dvl.rate_hz));
  std::size_t k = 0;
  const DvlSample* before = nullptr;
  for (const auto& s : faulty) {
    const auto& dvl = std::get<DvlSample>(s.sample);
    const double t = timeOf(dvl.utc_ns);
    EXPECT_FALSE(t >= 60 && t < 90);
    while (std::get<DvlSample>(healthy[k].sample).utc_ns < dvl.utc_ns) ++k;
    const auto& good = std::get<DvlSample>(healthy[k].sample);
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

TEST_F(SensorTest, ACompassJumpTurnsTheHeadingFromThenOn) {
  CompassConfig config;
  LoggedSamples healthy, faulty;
  simulateCompass(world(), config, healthy);
  config.jumps = {{100, 20 * kDegree}, {150, -5 * kDegree}};
  simulateCompass(world(), config, faulty);
  ASSERT_EQ(healthy.size(), faulty.size());
  for (std::size_t k = 0; k < healthy.size(); ++k) {
    const auto& a = std::get<AttitudeSample>(healthy[k].sample);
    const auto& b = std::get<AttitudeSample>(faulty[k].sample);
    const double t = timeOf(a.utc_ns), expected = t < 99.99 ? 0 : t < 149.99 ? 20 : 15;
    if (std::abs(t - 100) < 0.05 || std::abs(t - 150) < 0.05) continue;
    EXPECT_NEAR(wrapAngle(b.heading - a.heading) / kDegree, expected, 1e-6) << t;
    EXPECT_EQ(a.roll, b.roll);
  }
}

TEST_F(SensorTest, AMagneticAnomalyTurnsHeadingsWhereItIsAndNothingElse) {
  CompassConfig config;
  LoggedSamples healthy, faulty;
  const SensorWorld w = world();
  simulateCompass(w, config, healthy);
  const Eigen::Vector3d place = (trajectory.poseAt(120) * w.T_body_compass).translation();
  config.anomalies = {{place.x(), place.y(), 2, 20 * kDegree}};
  simulateCompass(w, config, faulty);
  ASSERT_EQ(healthy.size(), faulty.size());
  double nearest = 1e9, at_nearest = 0;
  for (std::size_t k = 0; k < healthy.size(); ++k) {
    const auto& a = std::get<AttitudeSample>(healthy[k].sample);
    const auto& b = std::get<AttitudeSample>(faulty[k].sample);
    const Eigen::Vector3d here = (trajectory.poseAt(timeOf(a.utc_ns)) * w.T_body_compass).translation();
    const double distance = (here - place).head<2>().norm(), turned = wrapAngle(b.heading - a.heading);
    EXPECT_NEAR(turned, 20 * kDegree / std::pow(1 + distance * distance / 4, 1.5), 1e-6);
    EXPECT_EQ(a.roll, b.roll);
    if (distance < nearest) nearest = distance, at_nearest = turned;
  }
  EXPECT_NEAR(at_nearest, 20 * kDegree, 0.1 * kDegree);
}

TEST_F(SensorTest, AGyroDriftsByItsBiasAndItsRandomWalkAndIsOffUnlessAskedFor) {
  GyroConfig config;
  LoggedSamples samples;
  const SensorWorld w = world();
  simulateGyro(w, config, samples);
  EXPECT_TRUE(samples.empty());
  config.rate_hz = 50;
  simulateGyro(w, config, samples);
  Statistics white;
  Eigen::Quaterniond turned = Eigen::Quaterniond::Identity(), first;
  double before = 0, previous = 0;
  for (const auto& s : samples) {
    const auto& gyro = std::get<GyroSample>(s.sample);
    const double t = timeOf(gyro.utc_ns);
    if (t < 30 || t > 230) continue;
    if (before == 0) first = (trajectory.poseAt(t) * w.T_body_compass).rotation();
    if (before > 0) {
      const Eigen::Vector3d phi = *gyro.body_rate * (t - before);
      turned = turned * Eigen::AngleAxisd(phi.norm(), phi.normalized());
    }
    // What is left of the rate of roll, smooth over a fiftieth of a second: noise.
    if (before > 0) white.add(gyro.body_rate->x() - previous);
    previous = gyro.body_rate->x();
    before = t;
  }
  const Eigen::Quaterniond last = (trajectory.poseAt(before) * w.T_body_compass).rotation();
  const double error = (first * turned).angularDistance(last);
  // 200 s: a bias of 3e-4 deg/s is 0.06 degrees, the walk of the angle 0.03, of each axis.
  EXPECT_LT(error, 0.4 * kDegree);
  EXPECT_GT(error, 0.005 * kDegree);
  EXPECT_GT(white.sigma(), 0.0);
}

TEST_F(SensorTest, CompassStaysWithinTwoDegreesAndTiltWithinHalfADegree) {
  const CompassConfig config;
  LoggedSamples samples;
  const SensorWorld w = world();
  simulateCompass(w, config, samples);
  Statistics heading, roll, pitch, step;
  double previous = 0;
  for (const auto& s : samples) {
    const auto& a = std::get<AttitudeSample>(s.sample);
    const Eigen::Vector3d truth = (trajectory.poseAt(timeOf(a.utc_ns)) * w.T_body_compass).euler();
    EXPECT_TRUE(a.magnetic);
    EXPECT_GE(a.heading, 0.0);
    EXPECT_LT(a.heading, 2 * std::numbers::pi);
    const double error = wrapAngle(a.heading + w.magnetic_declination - truth.z());
    EXPECT_LT(std::abs(error), 3.5 * kDegree);
    if (heading.count > 0) step.add(error - previous);
    previous = error;
    heading.add(error);
    roll.add(a.roll - truth.x());
    pitch.add(a.pitch - truth.y());
    EXPECT_LT(std::abs(a.roll - truth.x()), 1.2 * kDegree);
    EXPECT_LT(std::abs(a.pitch - truth.y()), 1.2 * kDegree);
  }
  EXPECT_GT(heading.sigma(), 0.3 * kDegree) << "a deviation must be there";
  // From sample to sample only the white part changes.
  EXPECT_NEAR(step.sigma(), config.heading_sigma * std::sqrt(2.0), 0.15 * config.heading_sigma);
  EXPECT_NEAR(roll.sigma(), config.tilt_sigma, 0.15 * config.tilt_sigma);
}

TEST_F(SensorTest, DepthFollowsTheSensorAndTheTide) {
  SensorsConfig config;
  config.tide.amplitude_m = 0.5;
  config.tide.period_s = 600;
  LoggedSamples samples;
  const SensorWorld w = world();
  simulateDepth(w, config, samples);
  Statistics error;
  for (const auto& s : samples) {
    const auto& d = std::get<DepthSample>(s.sample);
    const double t = timeOf(d.utc_ns);
    const double truth = (trajectory.poseAt(t) * w.T_body_depth).translation().z() +
                         0.5 * std::sin(2 * std::numbers::pi * t / 600);
    error.add(d.depth - truth);
  }
  EXPECT_LT(std::abs(error.mean()), 5 * config.depth.scale_error * kSeafloor);
  EXPECT_NEAR(error.sigma(), config.depth.sigma_m, 0.2 * config.depth.sigma_m);
}

TEST_F(SensorTest, UsblFixesAreLateAccurateAndSometimesWildlyWrong) {
  UsblConfig config;
  config.period_s = 0.5;
  LoggedSamples samples;
  const SensorWorld w = world();
  simulateUsbl(w, config, samples);
  const LocalTransverseMercator mercator(w.origin);
  std::vector<double> errors;
  int wild = 0;
  for (const auto& s : samples) {
    const auto& fix = std::get<UsblFix>(s.sample);
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
  EXPECT_NEAR(std::get<UsblFix>(samples.front().sample).sigma_horizontal, rms / std::numbers::sqrt2, 0.06);
}

TEST_F(SensorTest, GpsIsThereOnlyAtTheSurface) {
  LoggedSamples samples;
  const SensorWorld w = world();
  simulateGps(w, GpsConfig(), samples);
  int before = 0, after = 0;
  for (const auto& s : samples) {
    const double t = timeOf(std::get<GpsFix>(s.sample).utc_ns);
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
  LoggedSamples a, b;
  simulateDepth(world(), config, a);
  config.dvl.rate_hz = 9;
  LoggedSamples other;
  simulateDvl(world(), config, other);
  simulateDepth(world(), config, b);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i)
    EXPECT_EQ(std::get<DepthSample>(a[i].sample).depth, std::get<DepthSample>(b[i].sample).depth);
  LoggedSamples c;
  simulateDepth(world(8), config, c);
  EXPECT_NE(std::get<DepthSample>(a[3].sample).depth, std::get<DepthSample>(c[3].sample).depth);
}

TEST_F(SensorTest, ABatteryLosesTheEnergyThatItGives) {
  SensorsConfig config;
  config.battery.rate_hz = 1;
  LoggedSamples samples;
  simulateBattery(world(), config.battery, samples);
  ASSERT_GT(samples.size(), 100U);
  double given_wh = 0, last_charge = config.battery.start_charge;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& b = std::get<BatterySample>(samples[i].sample);
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
  LoggedSamples samples;
  simulateBattery(world(), config.battery, samples);
  EXPECT_EQ(std::get<BatterySample>(samples.back().sample).charge, 0.0);
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
