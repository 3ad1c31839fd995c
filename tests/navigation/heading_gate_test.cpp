#include "recon/navigation/gating/heading_gate.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

namespace fathom::slam {
namespace {

// A straight track of one-second steps: the compass errs by `anomaly` at
// each step's end, link `false_at` by `false_turn`.
struct HeadingTrack {
  std::vector<double> anomaly;
  int false_at = -1;
  double false_turn = 0;
  bool gyro = false, visual = true, confirmed = false;
};

StepTurns stepOf(const HeadingTrack& track, int k) {
  StepTurns step;
  step.seconds = 1;
  const auto at = static_cast<std::size_t>(k);
  step.compass = track.anomaly[at] - (k == 0 ? 0 : track.anomaly[at - 1]);
  step.has_visual = track.visual;
  step.visual = k == track.false_at ? track.false_turn : 0;
  step.visual_sigma = 0.1 * kRadiansPerDegree;
  step.confirmed = track.confirmed;
  step.has_gyro = track.gyro;
  step.gyro_sigma = 0.02 * kRadiansPerDegree;
  return step;
}

HeadingGate after(const HeadingTrack& track) {
  HeadingGate gate;
  for (int k = 0; k < static_cast<int>(track.anomaly.size()); ++k) gate.add(stepOf(track, k));
  return gate;
}

HeadingTrack bump(double degrees, double sigma, int steps = 200, int at = 90) {
  HeadingTrack track;
  for (int k = 0; k < steps; ++k)
    track.anomaly.push_back(degrees * kRadiansPerDegree * std::exp(-0.5 * std::pow((k - at) / sigma, 2)));
  return track;
}

int blamed(const HeadingGate& gate) {
  int count = 0;
  for (std::int64_t k = 0; k < gate.steps(); ++k) count += gate.verdict(k).visual ? 0 : 1;
  return count;
}

int restarts(const HeadingGate& gate) {
  int count = 0;
  for (std::int64_t k = 0; k < gate.steps(); ++k) count += gate.verdict(k).restarts ? 1 : 0;
  return count;
}

TEST(HeadingGate, AnAnomalyIsTheCompasssAndEndsWithIt) {
  for (const auto& [degrees, sigma] : {std::pair{10.0, 3.0}, {20.0, 5.0}, {40.0, 12.0}, {-25.0, 8.0}}) {
    const HeadingGate gate = after(bump(degrees, sigma));
    EXPECT_EQ(blamed(gate), 0) << degrees;
    EXPECT_EQ(restarts(gate), 0) << degrees;
    EXPECT_FALSE(gate.verdict(90).compass) << degrees;
    EXPECT_TRUE(gate.verdict(20).compass) << degrees;
    EXPECT_TRUE(gate.verdict(170).compass) << degrees;
  }
}

TEST(HeadingGate, AFalseLinkIsBlamedAndTheCompassIsNot) {
  for (const double degrees : {4.0, -7.0, 10.0}) {
    HeadingTrack track = bump(0, 1);
    track.false_at = 60;
    track.false_turn = degrees * kRadiansPerDegree;
    const HeadingGate gate = after(track);
    EXPECT_EQ(blamed(gate), 1) << degrees;
    EXPECT_FALSE(gate.verdict(60).visual) << degrees;
    for (const std::int64_t k : {59, 60, 61, 100, 199}) EXPECT_TRUE(gate.verdict(k).compass) << k;
  }
}

TEST(HeadingGate, AFalseLinkAmidAnAnomalyIsFound) {
  HeadingTrack track = bump(20, 5);
  track.false_at = 93;
  track.false_turn = 8 * kRadiansPerDegree;
  const HeadingGate gate = after(track);
  EXPECT_EQ(blamed(gate), 1);
  EXPECT_FALSE(gate.verdict(93).visual);
  EXPECT_TRUE(gate.verdict(150).compass);
}

TEST(HeadingGate, AGyroDistinguishesAJumpOfTheCompassFromAFalseLink) {
  HeadingTrack leap = bump(0, 1);
  for (std::size_t k = 60; k < leap.anomaly.size(); ++k) leap.anomaly[k] = 7 * kRadiansPerDegree;
  // Without a gyro a link that is turned by as much is likelier.
  EXPECT_EQ(blamed(after(leap)), 1);
  leap.gyro = true;
  const HeadingGate gate = after(leap);
  EXPECT_EQ(blamed(gate), 0);
  EXPECT_EQ(restarts(gate), 1);
  EXPECT_TRUE(gate.verdict(60).restarts);
  HeadingTrack link = bump(0, 1);
  link.gyro = true;
  link.false_at = 60;
  link.false_turn = 7 * kRadiansPerDegree;
  EXPECT_EQ(blamed(after(link)), 1);
  EXPECT_EQ(restarts(after(link)), 0);
}

TEST(HeadingGate, SoDoTheOtherSensorsWhereTheyConfirmTheLink) {
  for (const double degrees : {4.0, -7.0, 10.0, 25.0}) {
    HeadingTrack leap = bump(0, 1);
    for (std::size_t k = 60; k < leap.anomaly.size(); ++k) leap.anomaly[k] = degrees * kRadiansPerDegree;
    leap.confirmed = true;
    const HeadingGate gate = after(leap);
    EXPECT_EQ(blamed(gate), 0) << degrees;
    EXPECT_EQ(restarts(gate), 1) << degrees;
    EXPECT_TRUE(gate.verdict(60).restarts) << degrees;
  }
  HeadingTrack track = bump(20, 5);
  track.confirmed = true;
  EXPECT_FALSE(after(track).verdict(90).compass);
}

TEST(HeadingGate, WithAGyroAnAnomalyIsSeenWithoutPictures) {
  HeadingTrack track = bump(20, 5);
  track.visual = false;
  EXPECT_TRUE(after(track).verdict(90).compass);  // no sensor contradicts it
  track.gyro = true;
  EXPECT_FALSE(after(track).verdict(90).compass);
  EXPECT_TRUE(after(track).verdict(150).compass);
}

TEST(HeadingGate, LearnsTheGyrosBias) {
  HeadingGate gate;
  for (int k = 0; k < 200; ++k) {
    StepTurns step;
    step.seconds = 1;
    step.has_visual = step.has_gyro = true;
    step.visual_sigma = 0.1 * kRadiansPerDegree;
    step.gyro_sigma = 0.02 * kRadiansPerDegree;
    step.gyro = 8e-4;
    gate.add(step);
  }
  EXPECT_NEAR(gate.gyroBias(), 8e-4, 2e-5);
}

}  // namespace
}  // namespace fathom::slam
