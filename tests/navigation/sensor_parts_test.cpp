#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "realtime/base/units.hpp"
#include "recon/navigation/dead_reckoning/camera_clock.hpp"
#include "recon/navigation/dead_reckoning/sensor_history.hpp"
#include "recon/navigation/sensors/mounting_check.hpp"
#include "tests/world/dive.hpp"

namespace fathom::nav {
namespace {

constexpr std::int64_t kCameraStart_ns = 1'700'000'000'000'000'000;

std::int64_t cameraTime(double s) {
  return kCameraStart_ns + std::llround(s * kNanosecondsPerSecond);
}

// Largest error [s] of the corrected times of a camera at 2 Hz whose
// clock gains `rate`, after the first minute.
double worst(double rate, double jitter, double duration) {
  CameraClock clock;
  std::mt19937 random(5);
  std::exponential_distribution<double> late(1 / std::max(jitter, 1e-9));
  double error = 0;
  for (int i = 0; i / 2.0 < duration; ++i) {
    const double t = i / 2.0;
    const std::int64_t utc =
        clock.utcNs(cameraTime(t + rate * t), cameraTime(t + 0.15 + (jitter > 0 ? late(random) : 0)));
    if (t > 60)
      error = std::max(error, std::abs(static_cast<double>(utc - cameraTime(t))) / kNanosecondsPerSecond);
  }
  return error;
}

TEST(CameraClock, FollowsAClockThatGainsOrLosesForFiveHours) {
  for (const double rate : {50e-6, -100e-6, 0.0}) EXPECT_LT(worst(rate, 0, 5 * 3600), 2e-4) << rate;
}

TEST(CameraClock, LateImagesDoNotMoveIt) {
  EXPECT_LT(worst(50e-6, 0.01, 3600), 0.004);
}

TEST(CameraClock, SurvivesALeapAndCountsIt) {
  CameraClock clock;
  double error = 0;
  for (int i = 0; i < 4000; ++i) {
    const double t = i / 2.0, camera = t * (1 + 50e-6) + (t > 1000 ? 3.0 : 0.0);
    const std::int64_t utc = clock.utcNs(cameraTime(camera), cameraTime(t + 0.15));
    if (t > 60 && (t < 1000 || t > 1015))
      error = std::max(error, std::abs(static_cast<double>(utc - cameraTime(t))));
  }
  EXPECT_EQ(clock.leaps(), 1U);
  EXPECT_LT(error / kNanosecondsPerSecond, 0.003);
}

TEST(CameraClock, LeavesTheFirstStampsAsTheyAre) {
  CameraClock clock;
  EXPECT_EQ(clock.utcNs(cameraTime(3), cameraTime(3.2)), cameraTime(3));
  EXPECT_EQ(clock.utcNs(cameraTime(3.5), cameraTime(3.7)), cameraTime(3.5));
}

constexpr double kStep = 0.1;  // [s]

// A vehicle that heaves slowly, its pressure sensor in a swell, its DVL off by a constant.
struct Sea {
  double amplitude = 0, period = 8;  // of the swell, in depth by pressure [m], [s]
  double bias = 0;                   // of the vertical velocity [m/s]
  double noise = 0;                  // of the pressure sensor [m]
  std::mt19937 random{3};

  [[nodiscard]] static double depthAt(double t) { return 15 + 0.8 * std::sin(2 * std::numbers::pi * t / 50); }
  double pressureAt(double t) {
    return depthAt(t) + amplitude * std::sin(2 * std::numbers::pi * t / period) +
           std::normal_distribution<double>(0, noise)(random);
  }
};

// Errors over the time from `from` on: the mean, and the largest change of the error in a second.
struct Errors {
  double mean = 0, change = 0;
};

Errors errorsOf(DepthFilter& filter, Sea sea, double from, double until) {
  filter.start(sea.pressureAt(0));
  std::vector<double> errors;
  for (int i = 1; i * kStep < until; ++i) {
    const double t = i * kStep;
    filter.add(kStep, Sea::depthAt(t) - Sea::depthAt(t - kStep) + sea.bias * kStep, sea.pressureAt(t));
    if (t >= from) errors.push_back(filter.depth() - Sea::depthAt(t));
  }
  Errors out;
  constexpr std::size_t kSecond = 10;
  for (std::size_t k = 0; k < errors.size(); ++k) {
    out.mean += errors[k] / static_cast<double>(errors.size());
    if (k >= kSecond) out.change = std::max(out.change, std::abs(errors[k] - errors[k - kSecond]));
  }
  return out;
}

TEST(DepthFilter, ASwellIsSmoothedOutAndItsSizeIsKnown) {
  DepthFilter filter;
  const Errors errors = errorsOf(filter, {.amplitude = 0.38, .bias = 0.002}, 90, 300);
  EXPECT_NEAR(filter.sigma(), 0.38 / std::numbers::sqrt2, 0.05);
  EXPECT_LT(errors.change, 0.012);  // by pressure: 0.29 m
  EXPECT_NEAR(errors.mean, 0.026, 0.01);
}

TEST(DepthFilter, ACalmSeasDepthIsThePressureSensors) {
  DepthFilter filter;
  const Errors errors = errorsOf(filter, {.bias = 0.002, .noise = 0.003}, 30, 300);
  EXPECT_EQ(filter.sigma(), 0);
  EXPECT_NEAR(errors.mean, std::numbers::sqrt2 * 0.002 / 0.8, 0.001);
  EXPECT_LT(errors.change, 0.006);
}

TEST(DepthFilter, AVelocityThatIsWrongForAWhileIsNotTakenForASwell) {
  DepthFilter filter;
  Sea calm{.noise = 0.003};
  (void)errorsOf(filter, calm, 0, 60);
  for (int i = 600; i < 800; ++i) {
    const double t = i * kStep;
    filter.add(kStep, Sea::depthAt(t) - Sea::depthAt(t - kStep) + 0.1 * kStep, calm.pressureAt(t));
  }
  EXPECT_LT(filter.sigma(), 0.03);
  EXPECT_LT(std::abs(filter.pressureOff()), 0.4);
}

TEST(DepthFilter, PressureThatComesBackWithAnotherValueIsFollowedWithoutAJump) {
  DepthFilter filter;
  filter.start(10);
  for (int i = 0; i < 50; ++i) filter.addWithoutPressure(0.01);
  EXPECT_NEAR(filter.depth(), 10.5, 1e-9);
  EXPECT_EQ(filter.pressureOff(), 0);
  double before = filter.depth(), largest = 0;
  for (int i = 0; i < 200; ++i) {
    filter.add(kStep, 0, 11.5);
    largest = std::max(largest, std::abs(filter.depth() - before));
    before = filter.depth();
  }
  EXPECT_LT(largest, 0.05);
  EXPECT_NEAR(filter.depth(), 11.5, 0.001);
  EXPECT_LT(filter.sigma(), 0.001);
}

TEST(TimeGate, TakesGrowingTimesOnly) {
  TimeGate gate;
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kOutOfOrder);
  EXPECT_EQ(gate.check(9 * kSecond_ns), TimeCheck::kOutOfOrder);
  EXPECT_EQ(gate.check(11 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.newestUtcNs(), 11 * kSecond_ns);
}

TEST(TimeGate, DropsALoneStampFarAheadAndGoesOn) {
  TimeGate gate;
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(1000 * kSecond_ns), TimeCheck::kLeap);
  EXPECT_EQ(gate.check(11 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(1001 * kSecond_ns), TimeCheck::kLeap);
}

TEST(TimeGate, AcceptsARealGapFromItsSecondSample) {
  TimeGate gate;
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(1000 * kSecond_ns), TimeCheck::kLeap);
  EXPECT_EQ(gate.check(1001 * kSecond_ns), TimeCheck::kGood);
  EXPECT_EQ(gate.check(1002 * kSecond_ns), TimeCheck::kGood);
}

TEST(TimeGate, RefusesTimesThatAreNone) {
  TimeGate gate;
  EXPECT_EQ(gate.check(std::numeric_limits<std::int64_t>::min()), TimeCheck::kImpossible);
  EXPECT_EQ(gate.check(std::numeric_limits<std::int64_t>::max()), TimeCheck::kImpossible);
  EXPECT_EQ(gate.check(0), TimeCheck::kImpossible);
  EXPECT_FALSE(gate.any());
  EXPECT_EQ(gate.check(10 * kSecond_ns), TimeCheck::kGood);
}

// Of a sensor that speaks every `interval`, some of whose samples are lost.
std::int64_t silenceAfter(std::int64_t interval, int samples, const std::vector<int>& lost) {
  TimeGate gate;
  for (int i = 0; i < samples; ++i)
    if (std::find(lost.begin(), lost.end(), i) == lost.end()) {
      EXPECT_EQ(gate.check(kSecond_ns + i * interval), TimeCheck::kGood);
    }
  return gate.silenceNs();
}

TEST(TimeGate, ASensorIsSilentAfterThreeOfItsPeriodsWithinBounds) {
  EXPECT_EQ(silenceAfter(kSecond_ns / 10, 20, {}), kSecond_ns);
  EXPECT_EQ(silenceAfter(2 * kSecond_ns, 20, {}), 6 * kSecond_ns);
  EXPECT_EQ(silenceAfter(4 * kSecond_ns, 20, {}), 10 * kSecond_ns);
  EXPECT_EQ(silenceAfter(2 * kSecond_ns, 2, {}), 6 * kSecond_ns);
  EXPECT_EQ(silenceAfter(2 * kSecond_ns, 1, {}), 10 * kSecond_ns);  // nothing is known of it yet
}

TEST(TimeGate, ALostSampleOrAnOutageDoesNotChangeThePeriod) {
  EXPECT_EQ(silenceAfter(2 * kSecond_ns, 20, {15}), 6 * kSecond_ns);
  EXPECT_EQ(silenceAfter(kSecond_ns / 5, 100, {90, 91, 92, 93, 94, 95, 96}), kSecond_ns);
}

TEST(TimeGate, TakesEverySampleOfASensorThatSpeaksEveryFourSecondsAlsoBehindALostOne) {
  TimeGate gate;
  for (int i = 1; i < 20; ++i)
    if (i != 10) {
      EXPECT_EQ(gate.check(4 * i * kSecond_ns), TimeCheck::kGood);
    }
}

TEST(SensorHistory, InterpolatesBetweenAndHoldsBeyondItsEnds) {
  NumberHistory history;
  history.pushDroppingOldest({10, 1.0});
  EXPECT_EQ(numberAt(history, 5), 1.0);
  EXPECT_EQ(numberAt(history, 15), 1.0);
  history.pushDroppingOldest({20, 3.0});
  EXPECT_DOUBLE_EQ(numberAt(history, 15), 2.0);
  EXPECT_EQ(numberAt(history, 10), 1.0);
  EXPECT_EQ(numberAt(history, 25), 3.0);
}

TEST(SensorHistory, RotationsTakeTheShortArc) {
  RotationHistory history;
  const Eigen::Quaterniond a(Eigen::AngleAxisd(3.0, Eigen::Vector3d::UnitZ()));
  Eigen::Quaterniond b(Eigen::AngleAxisd(3.4, Eigen::Vector3d::UnitZ()));
  b.coeffs() = -b.coeffs();  // the same rotation
  history.pushDroppingOldest({0, a});
  history.pushDroppingOldest({10, b});
  const Eigen::Quaterniond middle(Eigen::AngleAxisd(3.2, Eigen::Vector3d::UnitZ()));
  EXPECT_LT(rotationAt(history, 5).angularDistance(middle), 1e-9);
}

TEST(SensorHistory, FindsTheFirstElementAfterATime) {
  NumberHistory history;
  EXPECT_EQ(firstAfter(history, 0), 0u);
  for (int i = 1; i <= 5; ++i) history.pushDroppingOldest({10 * i, 0.0});
  EXPECT_EQ(firstAfter(history, 0), 0u);
  EXPECT_EQ(firstAfter(history, 10), 1u);
  EXPECT_EQ(firstAfter(history, 34), 3u);
  EXPECT_EQ(firstAfter(history, 50), 5u);
}

}  // namespace
}  // namespace fathom::nav

namespace fathom::slam {
namespace {

using testing::SyntheticDive, testing::SyntheticDiveOptions;

// Extrinsics and clocks that differ from the files.

SyntheticDive surveyed(std::uint64_t seed) {
  return testing::makeDive({.seed = seed, .lines = 8, .interval = 0.4, .false_links = 5});
}

// Dead reckoning of a camera that is turned and whose images were taken later than they say.
std::vector<KeyframeInput> withWrongMounting(const SyntheticDive& survey, const Eigen::Vector3d& turn,
                                             double offset) {
  Vector6d twist;
  twist << Eigen::Vector3d::Zero(), turn;
  const SE3 turned = SE3::exp(-twist);
  std::vector<KeyframeInput> frames = survey.inputs;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    SE3 T = survey.inputs[k].T_odom_cam;
    if (k > 0) {
      const KeyframeInput &before = survey.inputs[k - 1], &here = survey.inputs[k];
      const double share = 1 - offset / (static_cast<double>(here.utc_ns - before.utc_ns) * 1e-9);
      T = interpolate(before.T_odom_cam, T, share);
    }
    frames[k].T_odom_cam = T * turned;
  }
  return frames;
}

TEST(Mounting, OfATurnedCameraAndALateClockIsFoundWithinItsClaim) {
  const Eigen::Vector3d turn(0.02, -0.015, 0.03);
  const double offset = 0.08;
  constexpr int kSeeds = 20;
  Eigen::Matrix<double, 5, 1> squares = Eigen::Matrix<double, 5, 1>::Zero();
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const SyntheticDive survey = surveyed(seed);
    const auto links = measuredOf(survey, 1).links;
    const Mounting found = mountingOf(withWrongMounting(survey, turn, offset), links, {});
    // What attitude sensor and DVL are turned by, the camera is turned against them.
    const Eigen::Vector3d known =
        turn - Eigen::Vector3d(survey.tilt_bias.x(), survey.tilt_bias.y(), survey.dvl_heading);
    squares.head<3>() += (found.camera_turn - known).cwiseQuotient(found.camera_turn_sigma).cwiseAbs2();
    squares(3) += std::pow((found.dvl_scale + survey.dvl_scale) / found.dvl_scale_sigma, 2);
    squares(4) += std::pow((found.time_offset - offset) / found.time_offset_sigma, 2);
    // Taken out of the clock, the offset does at least half of what it promises.
    const Mounting in_time = mountingOf(withWrongMounting(survey, turn, 0), links, {});
    EXPECT_LT(in_time.misfit, 0.5 * (found.misfit + found.misfit_unshifted));
    EXPECT_LT(found.misfit, found.misfit_unshifted);
    EXPECT_LT(found.camera_turn_sigma.maxCoeff(), 0.01);
    EXPECT_LT(found.time_offset_sigma, 0.03);
  }
  // 99 % of chi-square with 20 degrees of freedom.
  for (int i = 0; i < 5; ++i) {
    EXPECT_GT(squares(i), 7.4) << i;
    EXPECT_LT(squares(i), 40.0) << i;
  }
}

TEST(Mounting, PathsOfImagesAreSeenToBeTooLong) {
  constexpr double kTooLong = 0.02;
  constexpr int kSeeds = 10;
  double squares = 0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const SyntheticDive survey = surveyed(seed);
    std::vector<NavigationLink> links = measuredOf(survey, 1).links;
    for (NavigationLink& link : links)
      link.T_a_b = SE3(link.T_a_b.rotation(), (1 + kTooLong) * link.T_a_b.translation());
    const PathScale found = pathScaleOf(survey.inputs, links, Eigen::Vector3d::Zero(), {});
    EXPECT_GT(found.steps, 100);
    EXPECT_LT(found.sigma, 0.003);
    squares += std::pow((found.longer - std::log1p(kTooLong) + survey.dvl_scale) / found.sigma, 2);
  }
  // 99 % of chi-square with 10 degrees of freedom.
  EXPECT_GT(squares, 2.2);
  EXPECT_LT(squares, 25.2);
}

// The arm to a DVL that swings about the camera is as long as it is, whatever the images take paths for.
TEST(Mounting, PathsThroughTurnsSayTheSame) {
  constexpr double kTooLong = 0.03;
  const Eigen::Vector3d dvl_in_camera(0.3, -0.5, 0.1);
  for (const double turn : {0.0, 0.15, -0.15}) {  // each step [rad]
    std::vector<KeyframeInput> inputs(20);
    std::vector<NavigationLink> links;
    for (std::size_t k = 0; k < inputs.size(); ++k) {
      inputs[k].utc_ns = static_cast<std::int64_t>(k) * 500'000'000;
      if (k == 0) continue;
      const SE3 step = SE3::fromEuler(0, 0, turn, {0.25, 0.02, 0.01});
      inputs[k].T_odom_cam = inputs[k - 1].T_odom_cam * step;
      NavigationLink link;
      link.a = static_cast<std::uint32_t>(k - 1), link.b = static_cast<std::uint32_t>(k);
      link.T_a_b = SE3(step.rotation(), (1 + kTooLong) * step.translation());
      link.covariance = 1e-6 * Matrix6d::Identity();
      links.push_back(link);
    }
    EXPECT_NEAR(pathScaleOf(inputs, links, dvl_in_camera, {}).longer, std::log1p(kTooLong), 1e-6) << turn;
    EXPECT_EQ(pathScaleOf(inputs, std::span(links).first(2), dvl_in_camera, {}).steps, 0) << turn;
  }
}

// Many series of positions whose errors have a correlation time, drawn here.
TEST(UsblSigma, TheMeanOfUsblPositionsErrsAsTheirCorrelationAllows) {
  const SensorNoise noise;
  constexpr double kSigma = 0.3, kPositions = 400;
  constexpr int kSeries = 2000;
  for (const double period : {1.0, 5.0, 20.0}) {
    std::mt19937_64 random(7);
    std::normal_distribution<double> normal(0, kSigma);
    const double alike = std::exp(-period / noise.usbl_wander_s);
    double squares = 0;
    for (int series = 0; series < kSeries; ++series) {
      double error = normal(random), sum = 0;
      for (int k = 0; k < kPositions; ++k) {
        sum += error;
        error = alike * error + std::sqrt(1 - alike * alike) * normal(random);
      }
      squares += sum * sum / (kPositions * kPositions);
    }
    const double claimed = usblSigma(kSigma, period, noise) / std::sqrt(kPositions);
    EXPECT_NEAR(std::sqrt(squares / kSeries) / claimed, 1, 0.08) << period;
  }
}

TEST(UsblSigma, AUsblPositionAfterASilenceIsNotIndependentOfThoseBeforeIt) {
  SensorNoise noise;
  const double usual = usblSigma(0.3, 0.5 * noise.usbl_wander_s, noise);
  EXPECT_GT(usual, 0.3);
  EXPECT_EQ(usblSigma(0.3, 1e9, noise), usual);
  EXPECT_TRUE(std::isfinite(usblSigma(0.3, -5, noise)));  // stamps out of order
  noise.usbl_wander_s = 0;
  EXPECT_EQ(usblSigma(0.3, 1, noise), 0.3);
}

}  // namespace
}  // namespace fathom::slam
