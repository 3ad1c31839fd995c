#include "sim/vehicle/vehicle.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "recon/geometry/se3.hpp"
#include "sim/vehicle/survey_path.hpp"

namespace fathom::sim {
namespace {

SurveyPlan smallPlan() {
  return SurveyPlan{.lines = 3, .line_length = 10, .line_spacing = 1.2, .cross_lines = 2};
}

double flat(double, double) {
  return 12.0;
}

TEST(DubinsCurve, EndsAtTheWantedPoseForEveryGeometry) {
  for (const double distance : {0.0, 0.3, 1.1, 2.5, 7.0}) {
    for (double bearing = 0; bearing < 6.2; bearing += 0.7) {
      for (double h0 = -3; h0 < 3; h0 += 0.8) {
        for (double h1 = -3; h1 < 3; h1 += 0.9) {
          const Eigen::Vector2d to(distance * std::cos(bearing), distance * std::sin(bearing));
          const DubinsCurve curve = shortestDubins({0, 0}, h0, to, h1, 0.8);
          Eigen::Vector2d p(0, 0);
          double h = h0;
          for (std::size_t i = 0; i < 3; ++i) {
            const double k = curve.curvature[i], l = curve.length[i];
            if (k == 0) {
              p += l * Eigen::Vector2d(std::cos(h), std::sin(h));
            } else {
              p += Eigen::Vector2d(std::sin(h + k * l) - std::sin(h), std::cos(h) - std::cos(h + k * l)) / k;
              h += k * l;
            }
          }
          ASSERT_LT((p - to).norm(), 1e-6) << distance << " " << bearing << " " << h0 << " " << h1;
          ASSERT_NEAR(wrapAngle(h - h1), 0.0, 1e-6);
        }
      }
    }
  }
}

TEST(SurveyPath, VisitsEveryLineInOneUnbrokenCurve) {
  const auto lines = surveyLines(smallPlan());
  ASSERT_EQ(lines.size(), 5u);
  const SurveyPath path(lines, 0.8);
  double nearest_end = 1e9;
  Eigen::Vector2d previous = path.at(0).position;
  for (double s = 0.01; s <= path.length(); s += 0.01) {
    const Eigen::Vector2d p = path.at(s).position;
    ASSERT_NEAR((p - previous).norm(), 0.01, 1e-4) << "a gap at " << s;
    nearest_end = std::min(nearest_end, (p - lines.back().to).norm());
    previous = p;
  }
  EXPECT_LT(nearest_end, 0.02);
}

TEST(SurveyLines, CrossLinesReachBeyondTheOutermostLinesAndMeetEach) {
  SurveyPlan plan = smallPlan();
  plan.heading = 0.6;
  const auto lines = surveyLines(plan);
  for (std::size_t c = 3; c < lines.size(); ++c) {
    const Eigen::Vector2d d = lines[c].to - lines[c].from;
    EXPECT_NEAR(d.norm(), 2 * 1.2 + 2 * plan.overrun, 1e-9);
    EXPECT_NEAR(d.dot(lines[0].to - lines[0].from), 0.0, 1e-9);
  }
}

TEST(Vehicle, CruisesAtTheWantedSpeedAndAltitudeOnLines) {
  const Trajectory t = simulateVehicle(smallPlan(), VehicleConfig(), flat, 3);
  std::vector<double> speeds;
  for (double time = t.surveyBegin() + 6; time < t.surveyBegin() + 18; time += 0.1) {
    const auto state = t.at(time);
    speeds.push_back(state.velocity_nav.head<2>().norm());
    EXPECT_NEAR(12.0 - state.T_nav_body.translation().z(), 2.0, 0.2);
  }
  double mean = 0;
  for (const double v : speeds) mean += v / static_cast<double>(speeds.size());
  EXPECT_NEAR(mean, 0.5, 0.02);
}

TEST(Vehicle, FliesEachLineHigherWhereThePlanClimbs) {
  SurveyPlan plan = smallPlan();
  plan.climb_per_line = 0.4;
  const Trajectory t = simulateVehicle(plan, VehicleConfig(), flat, 3);
  const SurveyPath path(surveyLines(plan), VehicleConfig().turn_radius_m);
  double highest = 0;
  for (double time = t.surveyBegin(); time < t.surveyEnd(); time += 0.1)
    highest = std::max(highest, 12.0 - t.poseAt(time).translation().z());
  EXPECT_NEAR(12.0 - t.poseAt(t.surveyBegin() + 10).translation().z(), 2.0, 0.2);
  EXPECT_NEAR(highest, 2.0 + 4 * 0.4, 0.2);
  EXPECT_EQ(path.at(path.length()).rise, 1.6);
}

TEST(Vehicle, FloatsAtTheSurfaceBeforeAndAfterAndSurveysInBetween) {
  const VehicleConfig config;
  const Trajectory t = simulateVehicle(smallPlan(), config, flat, 3);
  EXPECT_NEAR(t.poseAt(1.0).translation().z(), config.float_depth_m, 0.01);
  EXPECT_NEAR(t.poseAt(t.duration() - 0.5).translation().z(), config.float_depth_m, 0.1);
  EXPECT_LT(t.diveBegin(), t.surveyBegin());
  EXPECT_LT(t.surveyBegin(), t.surveyEnd());
  EXPECT_LT(t.surveyEnd(), t.surfaced());
  EXPECT_LT(t.surfaced(), t.duration());
}

TEST(Vehicle, ComesDownSlowlyBehindALedgeSoThatTheAltitudeReachesSixMetres) {
  SurveyPlan plan{.lines = 2, .line_length = 20, .line_spacing = 1.5, .cross_lines = 0};
  const auto ledge = [](double north, double) { return north > -3.0 ? 13.0 : 9.0; };
  const Trajectory t = simulateVehicle(plan, VehicleConfig(), ledge, 5);
  double lowest = 1e9, highest = 0, last_high = 0;
  for (double time = t.surveyBegin(); time < t.surveyEnd(); time += 0.1) {
    const Eigen::Vector3d p = t.poseAt(time).translation();
    const double altitude = ledge(p.x(), p.y()) - p.z();
    lowest = std::min(lowest, altitude);
    highest = std::max(highest, altitude);
    if (altitude > 4.0) last_high = time;
  }
  EXPECT_GT(highest, 5.7);
  EXPECT_LT(highest, 6.4);
  EXPECT_GT(lowest, 0.9) << "the vehicle must not come near the wall on the return line";
  EXPECT_GT(last_high - t.surveyBegin(), 25.0);
}

TEST(Vehicle, ClimbsBeforeAWallInsteadOfMeetingIt) {
  SurveyPlan plan{.lines = 1, .line_length = 16, .cross_lines = 0};
  const auto wall = [](double north, double) { return north > 0.0 ? 8.0 : 13.0; };
  const Trajectory t = simulateVehicle(plan, VehicleConfig(), wall, 5);
  for (double time = t.surveyBegin(); time < t.surveyEnd(); time += 0.1) {
    const Eigen::Vector3d p = t.poseAt(time).translation();
    ASSERT_GT(wall(p.x(), p.y()) - p.z(), 0.8) << "at " << time;
  }
}

TEST(Vehicle, RollsAndPitchesByAFewDegreesAndCrabs) {
  const VehicleConfig config;
  const Trajectory t = simulateVehicle(smallPlan(), config, flat, 9);
  double roll2 = 0, pitch2 = 0;
  int count = 0;
  for (double time = t.surveyBegin(); time < t.surveyEnd(); time += 0.1) {
    const Eigen::Vector3d e = t.poseAt(time).euler();
    roll2 += e.x() * e.x();
    pitch2 += e.y() * e.y();
    ++count;
  }
  EXPECT_NEAR(std::sqrt(roll2 / count), config.roll_sigma, 0.4 * config.roll_sigma);
  EXPECT_NEAR(std::sqrt(pitch2 / count), config.pitch_sigma, 0.4 * config.pitch_sigma);
}

TEST(Vehicle, HoversIsThrownAsideAndPitchesAsItClimbs) {
  VehicleConfig config;
  const Trajectory plain = simulateVehicle(smallPlan(), config, flat, 9);
  const double at = plain.surveyBegin() + 10;
  config.hovers = {{at, 20}};
  const Trajectory hovers = simulateVehicle(smallPlan(), config, flat, 9);
  EXPECT_LT(hovers.at(at + 15).velocity_nav.head<2>().norm(), 0.06) << "it wanders";
  EXPECT_GT(hovers.duration(), plain.duration() + 19);
  config.hovers.clear();
  config.collisions = {{at, 0.3, degreesToRadians(15), 3}};
  const Trajectory hit = simulateVehicle(smallPlan(), config, flat, 9);
  double farthest = 0, turned = 0;
  for (double t = at - 1; t < at + 20; t += 0.1) {
    farthest = std::max(farthest, (hit.poseAt(t).translation() - plain.poseAt(t).translation()).norm());
    turned = std::max(turned, hit.poseAt(t).rotation().angularDistance(plain.poseAt(t).rotation()));
  }
  EXPECT_NEAR(farthest, 0.3 * 0.8, 0.03);  // it comes back while it is thrown
  EXPECT_NEAR(turned, 0.8 * degreesToRadians(15), 0.03);
  EXPECT_LT((hit.poseAt(at + 20).translation() - plain.poseAt(at + 20).translation()).norm(), 0.001);
  config.collisions.clear();
  config.climb_pitch = 1;
  config.pitch_sigma = 0;
  const Trajectory climbs = simulateVehicle(
      smallPlan(), config, [](double north, double) { return north > 0 ? 10.5 : 12.0; }, 9);
  double steepest = 0;
  for (double t = climbs.surveyBegin(); t < climbs.surveyEnd(); t += 0.1)
    steepest = std::max(steepest, climbs.poseAt(t).euler().y());
  EXPECT_GT(steepest, degreesToRadians(10));
}

TEST(Trajectory, VelocityAndRatesAreTheDerivativesOfThePose) {
  const Trajectory t = simulateVehicle(smallPlan(), VehicleConfig(), flat, 3);
  constexpr double kStep = 1e-4;
  for (double time = 5.03; time < t.duration() - 1; time += 3.7) {
    const auto state = t.at(time);
    const SE3 before = t.poseAt(time - kStep), after = t.poseAt(time + kStep);
    const Eigen::Vector3d velocity = (after.translation() - before.translation()) / (2 * kStep);
    EXPECT_LT((velocity - state.velocity_nav).norm(), 1e-5);
    const Eigen::Vector3d turn = (before.inverse() * after).log().tail<3>() / (2 * kStep);
    EXPECT_LT((turn - state.rates_body).norm(), 1e-5);
  }
}

TEST(Trajectory, AccelerationIsContinuousAcrossKnots) {
  const Trajectory t = simulateVehicle(smallPlan(), VehicleConfig(), flat, 3);
  constexpr double kStep = 1e-3;
  const double time = t.surveyBegin() + 12.0;  // a knot
  const auto acceleration = [&](double at) -> Eigen::Vector3d {
    return (t.at(at + kStep).velocity_nav - t.at(at - kStep).velocity_nav) / (2 * kStep);
  };
  EXPECT_LT((acceleration(time - 2 * kStep) - acceleration(time + 2 * kStep)).norm(), 0.02);
}

TEST(Vehicle, TheSurveyIsCutAtTheLongestDuration) {
  const Trajectory t = simulateVehicle(smallPlan(), VehicleConfig(), flat, 3, 15.0);
  EXPECT_NEAR(t.surveyEnd() - t.surveyBegin(), 15.0, 0.11);
}

}  // namespace
}  // namespace fathom::sim
