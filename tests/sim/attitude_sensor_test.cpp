// Compass, tilt sensor and gyro.

#include "realtime/base/units.hpp"
#include "tests/world/sim_scenes.hpp"

namespace fathom::sim {
namespace {

TEST_F(SensorTest, ACompassJumpTurnsTheHeadingFromThenOn) {
  CompassConfig config;
  const auto healthy = sampled<AttitudeSample>(simulateCompass, config);
  config.jumps = {{100, 20 * kRadiansPerDegree}, {150, -5 * kRadiansPerDegree}};
  const auto faulty = sampled<AttitudeSample>(simulateCompass, config);
  ASSERT_EQ(healthy.size(), faulty.size());
  for (std::size_t k = 0; k < healthy.size(); ++k) {
    const auto& a = healthy[k];
    const auto& b = faulty[k];
    const double t = timeOf(a.utc_ns), expected = t < 99.99 ? 0 : t < 149.99 ? 20 : 15;
    if (std::abs(t - 100) < 0.05 || std::abs(t - 150) < 0.05) continue;
    EXPECT_NEAR(wrapAngle(b.heading - a.heading) / kRadiansPerDegree, expected, 1e-6) << t;
    EXPECT_EQ(a.roll, b.roll);
  }
}

TEST_F(SensorTest, AMagneticAnomalyTurnsHeadingsWhereItIsAndNothingElse) {
  CompassConfig config;
  const SensorWorld w = world();
  const auto healthy = sampled<AttitudeSample>(simulateCompass, config);
  const Eigen::Vector3d place = (trajectory.poseAt(120) * w.T_body_compass).translation();
  config.anomalies = {{place.x(), place.y(), 0, 2, 20 * kRadiansPerDegree}};
  const auto faulty = sampled<AttitudeSample>(simulateCompass, config);
  ASSERT_EQ(healthy.size(), faulty.size());
  double nearest = 1e9, at_nearest = 0;
  for (std::size_t k = 0; k < healthy.size(); ++k) {
    const auto& a = healthy[k];
    const auto& b = faulty[k];
    const Eigen::Vector3d here = (trajectory.poseAt(timeOf(a.utc_ns)) * w.T_body_compass).translation();
    const double distance = (here - place).head<2>().norm(), turned = wrapAngle(b.heading - a.heading);
    EXPECT_NEAR(turned, 20 * kRadiansPerDegree / std::pow(1 + distance * distance / 4, 1.5), 1e-6);
    EXPECT_EQ(a.roll, b.roll);
    if (distance < nearest) nearest = distance, at_nearest = turned;
  }
  EXPECT_NEAR(at_nearest, 20 * kRadiansPerDegree, 0.1 * kRadiansPerDegree);
}

TEST_F(SensorTest, AnObjectOnTheSeafloorDoesNotTurnACompassFarAboveIt) {
  CompassConfig config;
  const SensorWorld w = world();
  const auto healthy = sampled<AttitudeSample>(simulateCompass, config);
  const Eigen::Vector3d place = (trajectory.poseAt(120) * w.T_body_compass).translation();
  const auto turnedBy = [&](double depth_m) {
    config.anomalies = {{place.x(), place.y(), depth_m, 2, 20 * kRadiansPerDegree}};
    const auto faulty = sampled<AttitudeSample>(simulateCompass, config);
    double most = 0;
    for (std::size_t k = 0; k < healthy.size(); ++k)
      if (std::abs(timeOf(healthy[k].utc_ns) - 120) < 0.2)
        most = std::max(most, std::abs(wrapAngle(faulty[k].heading - healthy[k].heading)));
    return most / kRadiansPerDegree;
  };
  EXPECT_NEAR(turnedBy(place.z() + 2), 20, 0.5);
  EXPECT_NEAR(turnedBy(place.z() + 6), 20.0 / 27, 0.05);
  EXPECT_NEAR(turnedBy(place.z() + 0.1), 160, 4);  // no more, however near
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
  Eigen::Quaterniond turned = Eigen::Quaterniond::Identity(), first = turned;
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
  EXPECT_LT(error, 0.4 * kRadiansPerDegree);
  EXPECT_GT(error, 0.005 * kRadiansPerDegree);
  EXPECT_GT(white.sigma(), 0.0);
}

TEST_F(SensorTest, CompassStaysWithinThreeDegreesAndTiltWithinSevenTenths) {
  const CompassConfig config;
  const SensorWorld w = world();
  const auto samples = sampled<AttitudeSample>(simulateCompass, config);
  Statistics heading, roll, pitch, step;
  Eigen::Vector3d worst = Eigen::Vector3d::Zero();  // [deg]
  double previous = 0;
  for (const AttitudeSample& a : samples) {
    const Eigen::Vector3d truth = (trajectory.poseAt(timeOf(a.utc_ns)) * w.T_body_compass).euler();
    EXPECT_TRUE(a.magnetic);
    EXPECT_GE(a.heading, 0.0);
    EXPECT_LT(a.heading, 2 * std::numbers::pi);
    const double error = wrapAngle(a.heading + w.magnetic_declination - truth.z());
    worst = worst.cwiseMax(Eigen::Vector3d(error, a.roll - truth.x(), a.pitch - truth.y()).cwiseAbs() /
                           kRadiansPerDegree);
    if (heading.count > 0) step.add(error - previous);
    previous = error;
    heading.add(error);
    roll.add(a.roll - truth.x());
    pitch.add(a.pitch - truth.y());
  }
  EXPECT_LT(worst.x(), 3.0);
  EXPECT_LT(worst.tail<2>().maxCoeff(), 0.7);
  EXPECT_GT(heading.sigma(), 0.3 * kRadiansPerDegree) << "a deviation must be there";
  // From sample to sample only the white part changes.
  EXPECT_NEAR(step.sigma(), config.heading_sigma * std::sqrt(2.0), 0.15 * config.heading_sigma);
  EXPECT_NEAR(roll.sigma(), config.tilt_sigma, 0.15 * config.tilt_sigma);
}

}  // namespace
}  // namespace fathom::sim
