#include "recon/slam/heading_trust.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace fathom::slam {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// A straight way of one-second steps: the compass errs by `anomaly` at each step's end, link `false_at` by
// `false_turn`.
struct Way {
  std::vector<double> anomaly;
  int false_at = -1;
  double false_turn = 0;
  bool gyro = false, visual = true, confirmed = false;
};

StepTurns stepOf(const Way& way, int k) {
  StepTurns step;
  step.seconds = 1;
  const auto at = static_cast<std::size_t>(k);
  step.compass = way.anomaly[at] - (k == 0 ? 0 : way.anomaly[at - 1]);
  step.has_visual = way.visual;
  step.visual = k == way.false_at ? way.false_turn : 0;
  step.visual_sigma = 0.1 * kDegree;
  step.confirmed = way.confirmed;
  step.has_gyro = way.gyro;
  step.gyro_sigma = 0.02 * kDegree;
  return step;
}

HeadingTrust after(const Way& way) {
  HeadingTrust trust;
  for (int k = 0; k < static_cast<int>(way.anomaly.size()); ++k) trust.add(stepOf(way, k));
  return trust;
}

Way bump(double degrees, double sigma, int steps = 200, int at = 90) {
  Way way;
  for (int k = 0; k < steps; ++k)
    way.anomaly.push_back(degrees * kDegree * std::exp(-0.5 * std::pow((k - at) / sigma, 2)));
  return way;
}

int blamed(const HeadingTrust& trust) {
  int count = 0;
  for (std::int64_t k = 0; k < trust.steps(); ++k) count += trust.verdict(k).visual ? 0 : 1;
  return count;
}

int restarts(const HeadingTrust& trust) {
  int count = 0;
  for (std::int64_t k = 0; k < trust.steps(); ++k) count += trust.verdict(k).restarts ? 1 : 0;
  return count;
}

TEST(HeadingTrust, AnAnomalyIsTheCompasssAndEndsWithIt) {
  for (const auto& [degrees, sigma] : {std::pair{10.0, 3.0}, {20.0, 5.0}, {40.0, 12.0}, {-25.0, 8.0}}) {
    const HeadingTrust trust = after(bump(degrees, sigma));
    EXPECT_EQ(blamed(trust), 0) << degrees;
    EXPECT_EQ(restarts(trust), 0) << degrees;
    EXPECT_FALSE(trust.verdict(90).compass) << degrees;
    EXPECT_TRUE(trust.verdict(20).compass) << degrees;
    EXPECT_TRUE(trust.verdict(170).compass) << degrees;
  }
}

TEST(HeadingTrust, AFalseLinkIsBlamedAndTheCompassIsNot) {
  for (const double degrees : {4.0, -7.0, 10.0}) {
    Way way = bump(0, 1);
    way.false_at = 60;
    way.false_turn = degrees * kDegree;
    const HeadingTrust trust = after(way);
    EXPECT_EQ(blamed(trust), 1) << degrees;
    EXPECT_FALSE(trust.verdict(60).visual) << degrees;
    for (const std::int64_t k : {59, 60, 61, 100, 199}) EXPECT_TRUE(trust.verdict(k).compass) << k;
  }
}

TEST(HeadingTrust, AFalseLinkAmidAnAnomalyIsFound) {
  Way way = bump(20, 5);
  way.false_at = 93;
  way.false_turn = 8 * kDegree;
  const HeadingTrust trust = after(way);
  EXPECT_EQ(blamed(trust), 1);
  EXPECT_FALSE(trust.verdict(93).visual);
  EXPECT_TRUE(trust.verdict(150).compass);
}

TEST(HeadingTrust, AGyroTellsALeapOfTheCompassFromAFalseLink) {
  Way leap = bump(0, 1);
  for (std::size_t k = 60; k < leap.anomaly.size(); ++k) leap.anomaly[k] = 7 * kDegree;
  // Without a gyro a link that is turned by as much is likelier.
  EXPECT_EQ(blamed(after(leap)), 1);
  leap.gyro = true;
  const HeadingTrust trust = after(leap);
  EXPECT_EQ(blamed(trust), 0);
  EXPECT_EQ(restarts(trust), 1);
  EXPECT_TRUE(trust.verdict(60).restarts);
  Way link = bump(0, 1);
  link.gyro = true;
  link.false_at = 60;
  link.false_turn = 7 * kDegree;
  EXPECT_EQ(blamed(after(link)), 1);
  EXPECT_EQ(restarts(after(link)), 0);
}

TEST(HeadingTrust, SoDoTheOtherSensorsWhereTheyConfirmTheLink) {
  for (const double degrees : {4.0, -7.0, 10.0, 25.0}) {
    Way leap = bump(0, 1);
    for (std::size_t k = 60; k < leap.anomaly.size(); ++k) leap.anomaly[k] = degrees * kDegree;
    leap.confirmed = true;
    const HeadingTrust trust = after(leap);
    EXPECT_EQ(blamed(trust), 0) << degrees;
    EXPECT_EQ(restarts(trust), 1) << degrees;
    EXPECT_TRUE(trust.verdict(60).restarts) << degrees;
  }
  Way way = bump(20, 5);
  way.confirmed = true;
  EXPECT_FALSE(after(way).verdict(90).compass);
}

TEST(HeadingTrust, WithAGyroAnAnomalyIsSeenWithoutPictures) {
  Way way = bump(20, 5);
  way.visual = false;
  EXPECT_TRUE(after(way).verdict(90).compass);  // nobody contradicts it
  way.gyro = true;
  EXPECT_FALSE(after(way).verdict(90).compass);
  EXPECT_TRUE(after(way).verdict(150).compass);
}

TEST(HeadingTrust, LearnsTheGyrosBias) {
  HeadingTrust trust;
  for (int k = 0; k < 200; ++k) {
    StepTurns step;
    step.seconds = 1;
    step.has_visual = step.has_gyro = true;
    step.visual_sigma = 0.1 * kDegree;
    step.gyro_sigma = 0.02 * kDegree;
    step.gyro = 8e-4;
    trust.add(step);
  }
  EXPECT_NEAR(trust.gyroBias(), 8e-4, 2e-5);
}

}  // namespace
}  // namespace fathom::slam
