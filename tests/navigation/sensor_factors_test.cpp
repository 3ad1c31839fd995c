#include "recon/navigation/sensors/sensor_factors.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <stdexcept>

#include "recon/navigation/sensors/dvl_calibration.hpp"

namespace fathom::slam {
namespace {

constexpr int kOrigin = 0, kA = 1, kB = 2;

// A camera that looks down, with some tilt.
SE3 camera(double north, double east, double depth, double heading, double tilt = 0.05) {
  return SE3::fromEuler(tilt, -0.5 * tilt, heading, {north, east, depth});
}

// The derivatives that the solvers use, against differences of the residual.
void expectDerivatives(const RelativePose& factor, const SE3& from, const SE3& to) {
  const RelativePoseLinear linear = linearize(factor, from, to);
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 6; ++i) {
    Vector6d step = Vector6d::Zero();
    step(i) = kStep;
    const Vector6d by_from = (relativePoseError(factor, perturbed(from, step), to) -
                              relativePoseError(factor, perturbed(from, -step), to)) /
                             (2 * kStep);
    const Vector6d by_to = (relativePoseError(factor, from, perturbed(to, step)) -
                            relativePoseError(factor, from, perturbed(to, -step))) /
                           (2 * kStep);
    EXPECT_LT((by_from - linear.by_from.col(i)).norm(), 1e-7 * (1 + by_from.norm())) << "from, " << i;
    EXPECT_LT((by_to - linear.by_to.col(i)).norm(), 1e-7 * (1 + by_to.norm())) << "to, " << i;
  }
}

double chi2(const RelativePose& factor, const SE3& from, const SE3& to) {
  const Vector6d e = relativePoseError(factor, from, to);
  return e.dot(factor.information * e);
}

const SensorNoise kNoise;
const Eigen::Vector3d kDvl(0.1, -0.7, 0.05);  // in the camera's axes

TEST(SensorFactors, TheFirstHeadingIsAMeanOfTheCompassHereAndOfTheOneThatAGyroCarries) {
  const auto headingOf = [](const CompassOff& off) {
    return firstAttitudeReference(kOrigin, kA, off, kNoise).T_from_to.euler().z();
  };
  const auto informationOf = [](const CompassOff& off) {
    return firstAttitudeReference(kOrigin, kA, off, kNoise).information(5, 5);
  };
  const auto sigmaOf = [&](const CompassOff& off) {
    return kNoise.deviation * std::sqrt(informationOf({}) / informationOf(off));
  };
  constexpr double kOff = 0.14;
  EXPECT_EQ(headingOf({}), 0);
  EXPECT_NEAR(headingOf({kOff, 60}), -0.85 * kOff, 0.1 * kOff);  // the compass here is the one that is off
  EXPECT_GT(sigmaOf({kOff, 60}), kNoise.deviation);
  EXPECT_LT(sigmaOf({kOff, 60}), 0.5 * kOff);
  EXPECT_NEAR(headingOf({kOff, 3600}), 0, 0.01 * kOff);  // after an hour the gyro says nothing
  EXPECT_NEAR(sigmaOf({kOff, 3600}), kNoise.deviation, 1e-3);
}

TEST(SensorFactors, DerivativesAreThoseOfTheResidual) {
  const SE3 a = camera(3, -2, 10, 0.7), b = camera(3.4, -1.7, 10.1, 0.9, -0.04);
  const SE3 reference = SE3::fromEuler(0.003, -0.002, 0.03, Eigen::Vector3d::Zero());
  const SE3 next = SE3::fromEuler(0.002, -0.001, 0.05, Eigen::Vector3d::Zero());
  const StepQuality quality{1.0, 0, 0, 0.003, 0};
  expectDerivatives(
      stepFactor(kA, kB, camera(3, -2, 10, 0.72), camera(3.5, -1.7, 10, 0.93), kDvl, quality, kNoise), a, b);
  expectDerivatives(attitudeFactor(kA, kB, camera(0, 0, 9, 0.95), kNoise), reference, b);
  expectDerivatives(firstAttitudeReference(kOrigin, kA, {0.1, 60}, kNoise), SE3(), reference);
  expectDerivatives(attitudeDrift(kA, kB, 20, 0.2, 0, kNoise), reference, next);
  expectDerivatives(tiltAbout(kOrigin, kA, 0.2, kNoise), SE3(), reference);
  expectDerivatives(depthFactor(kOrigin, kB, camera(1, 1, 10.2, 0.9), kNoise.depth), SE3(), b);
  const SE3 tide(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -0.4));
  expectDerivatives(firstTide(kOrigin, kA, kNoise), SE3(), tide);
  const SE3 later = SE3::fromEuler(0, 0.02, 0, {10, 0, -0.6});
  expectDerivatives(tideStep(kA, kB, 600, kNoise), tide, later);
  expectDerivatives(depthAtTide(kA, kB), later, tide);
  expectDerivatives(levelReference(kOrigin, kB), SE3(), SE3::fromEuler(1e-6, -2e-6, 0, {0, 0, -0.4}));
  expectDerivatives(fixFactor(kOrigin, kB, b, camera(0, 0, 10, 0.9), {1, 2, 9}, {4, 0}, 0.4), SE3(), b);
  Matrix6d covariance = Matrix6d::Identity() * 1e-4;
  covariance(0, 4) = covariance(4, 0) = 3e-5;
  expectDerivatives(linkFactor(kA, kB, a.inverse() * b, covariance), a, b);
}

TEST(SensorFactors, AStepErrsByOneStandardDeviationAlongThePathForOneUnitOfChiSquare) {
  const SE3 a = camera(0, 0, 10, 0.4, 0), b = camera(0.5 * std::cos(0.4), 0.5 * std::sin(0.4), 10, 0.4, 0);
  const StepQuality quality{1.0, 0, 0, 0.004, 0};
  const RelativePose factor = stepFactor(kA, kB, a, b, kDvl, quality, kNoise);
  EXPECT_NEAR(chi2(factor, a, b), 0, 1e-18);
  const double white = kNoise.dvl_velocity * std::sqrt(1.0 / kNoise.dvl_rate),
               wander = kNoise.dvl_wander * 0.5 * std::sqrt(2 * kNoise.dvl_wander_s);
  const double sigma = std::sqrt(white * white + wander * wander + std::pow(0.004 * 0.5, 2) +
                                 std::pow(kNoise.heading * 0.5, 2));
  const SE3 off(b.rotation(), b.translation() + sigma * Eigen::Vector3d(std::cos(0.4), std::sin(0.4), 0));
  EXPECT_NEAR(chi2(factor, a, off), 1, 1e-6);
}

// Of an exponentially correlated velocity error the displacement over T has the variance
// 2 s^2 tau (T - tau (1 - exp(-T / tau))).
TEST(SensorFactors, AChainOfShortStepsErrsAsAVelocityThatWanders) {
  constexpr double kSpeed = 0.8, kSpan = 300;  // [m/s], [s]
  const double s = kNoise.dvl_wander * kSpeed, tau = kNoise.dvl_wander_s,
               whole = std::sqrt(2 * s * s * tau * (kSpan - tau * (1 - std::exp(-kSpan / tau))));
  for (const double step : {0.5, 2.0, 30.0}) {
    const double one = wanderSigma(kSpeed * step, step, kNoise);
    EXPECT_NEAR(one * std::sqrt(kSpan / step), whole, 0.03 * whole) << step;
  }
  EXPECT_EQ(wanderSigma(0, 10, kNoise), 0);
  EXPECT_EQ(wanderSigma(1, 0, kNoise), 0);
}

TEST(SensorFactors, AStepIsThePathOfTheDvlWhateverTheCompassReadsAtItsEnd) {
  const SE3 a = camera(0, 0, 10, 0.4, 0), b = camera(0.5, 0.1, 10, 0.5, 0);
  // The compass has the camera turned about the DVL by 2 degrees.
  const double wrong = 0.035;
  const Eigen::Quaterniond turned = Eigen::AngleAxisd(wrong, Eigen::Vector3d::UnitZ()) * b.rotation();
  const SE3 reckoned(turned, b * kDvl - turned * kDvl);
  const StepQuality quality{1.0, 0, 0, 0.004, 0};
  SensorNoise noise{.dvl_wander = 0};
  EXPECT_LT(chi2(stepFactor(kA, kB, a, reckoned, kDvl, quality, noise), a, b), 0.05);
  EXPECT_GT(chi2(stepFactor(kA, kB, a, reckoned, Eigen::Vector3d::Zero(), quality, noise), a, b), 20);
}

TEST(SensorFactors, AStepWithoutBottomTrackSaysNextToNothing) {
  const SE3 a = camera(0, 0, 10, 0), b = camera(0.5, 0, 10, 0), metre_off = camera(1.5, 0, 10, 0);
  const StepQuality locked{10.0, 0, 0, 0.003, 0}, unlocked{10.0, 10.0, 0, 0.003, 0};
  EXPECT_GT(chi2(stepFactor(kA, kB, a, b, kDvl, locked, kNoise), a, metre_off), 1000);
  EXPECT_LT(chi2(stepFactor(kA, kB, a, b, kDvl, unlocked, kNoise), a, metre_off), 0.2);
}

TEST(SensorFactors, AttitudeGivesHeadingUpToTheDeviationOfItsReference) {
  const double deviation = 0.04;
  const SE3 reference = SE3::fromEuler(0, 0, -deviation, Eigen::Vector3d::Zero());
  // The compass reads 0.9 + deviation where the heading is 0.9.
  const RelativePose factor = attitudeFactor(kA, kB, camera(5, 5, 8, 0.9 + deviation, 0), kNoise);
  EXPECT_NEAR(chi2(factor, reference, camera(-70, 20, 3, 0.9, 0)), 0, 1e-6);
  EXPECT_NEAR(chi2(factor, reference, camera(-70, 20, 3, 0.9 + kNoise.heading, 0)), 1, 1e-3);
}

TEST(SensorFactors, DepthGivesDepthAloneWhateverTheAttitude) {
  const RelativePose factor = depthFactor(kOrigin, kB, camera(1, 2, 10, 0.3, 0.2), kNoise.depth);
  EXPECT_NEAR(chi2(factor, SE3(), camera(-400, 250, 10, 2.0, -0.1)), 0, 1e-6);
  EXPECT_NEAR(chi2(factor, SE3(), camera(-400, 250, 10 + kNoise.depth, 2.0, -0.1)), 1, 1e-6);
  const SE3 high_tide(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -1.2));
  EXPECT_NEAR(chi2(factor, high_tide, camera(0, 0, 8.8, 0.3)), 0, 1e-6);
}

TEST(SensorFactors, AFixOfAnAntennaBehindPlacesTheCameraAhead) {
  const SE3 T_nav_cam = camera(100, 50, 10, 0.3, 0), T_odom_cam = camera(7, 5, 10, 0.3, 0);
  // Two metres behind the camera when the ping came, three seconds before.
  const Eigen::Vector3d antenna =
      T_odom_cam.translation() - 2.0 * Eigen::Vector3d(std::cos(0.3), std::sin(0.3), 0.1);
  const Eigen::Vector2d fix =
      (T_nav_cam.translation() - 2.0 * Eigen::Vector3d(std::cos(0.3), std::sin(0.3), 0)).head<2>();
  const RelativePose factor = fixFactor(kOrigin, kB, T_nav_cam, T_odom_cam, antenna, fix, 0.5);
  EXPECT_NEAR(chi2(factor, SE3(), T_nav_cam), 0, 1e-9);
  EXPECT_NEAR(chi2(factor, SE3(), camera(100.5, 50, 12, 0.3, 0)), 1, 1e-6);
}

TEST(SensorFactors, ALinkWeighsItsErrorByItsCovariance) {
  const SE3 a = camera(0, 0, 10, 0), b = camera(0.4, 0.1, 10, 0.1);
  Vector6d sigma;
  sigma << 0.002, 0.003, 0.004, 0.001, 0.002, 0.003;
  const RelativePose factor = linkFactor(kA, kB, a.inverse() * b, sigma.cwiseAbs2().asDiagonal());
  for (int i = 0; i < 6; ++i) {
    Vector6d step = Vector6d::Zero();
    step(i) = sigma(i);
    EXPECT_NEAR(chi2(factor, a, perturbed(b, step)), 1, 1e-4) << i;
  }
}

TEST(SensorFactors, ALinkWeighsPlaceAndTurnTogetherWhereTheyAreCorrelated) {
  const SE3 a = camera(0, 0, 10, 0), b = camera(0.4, 0.1, 10, 0.1);
  Vector6d sigma;
  sigma << 0.002, 0.003, 0.004, 0.001, 0.002, 0.003;
  Matrix6d correlation = Matrix6d::Identity();
  for (int i = 0; i < 3; ++i) correlation(i, 3 + i) = correlation(3 + i, i) = 0.8;
  const Matrix6d covariance = sigma.asDiagonal() * correlation * sigma.asDiagonal();
  const RelativePose factor = linkFactor(kA, kB, a.inverse() * b, covariance);
  for (int i = 0; i < 3; ++i) {
    for (const double sign : {1.0, -1.0}) {
      Vector6d step = Vector6d::Zero();
      step(i) = sigma(i);
      step(3 + i) = sign * sigma(3 + i);
      const double expected = step.dot(covariance.inverse() * step);
      EXPECT_NEAR(chi2(factor, a, perturbed(b, step)) / expected, 1, 1e-3) << i << ' ' << sign;
    }
  }
}

TEST(SensorFactors, AStepIsLessCertainWhileAttitudeIsAway) {
  SensorNoise noise;
  StepQuality quality{.seconds = 10};
  const double known = stepSigma(2, quality, noise);
  quality.seconds_untilted = 10;
  const double turned = noise.unknown_turn * 10;  // half of it in the mean, over the path
  EXPECT_NEAR(stepSigma(2, quality, noise), std::hypot(known, 0.5 * turned * 2), 1e-9);
}

TEST(SensorFactors, NoiseOutOfRangeIsRefused) {
  SensorNoise noise{.heading = 0};
  EXPECT_THROW(noise.validate(), std::invalid_argument);
  noise = {};
  noise.deviation_drift = std::nan("");
  EXPECT_THROW(noise.validate(), std::invalid_argument);
}

TEST(Heading, IsTheVehiclesHoweverTheCameraIsMounted) {
  const SE3 mountings[] = {SE3::fromEuler(0, 0, M_PI / 2, {0, 0, 0}),         // down
                           SE3::fromEuler(M_PI / 4, 0, M_PI / 2, {0, 0, 0}),  // ahead, and down by 45 degrees
                           SE3::fromEuler(M_PI / 2, 0, M_PI / 2, {0, 0, 0}),  // ahead
                           SE3::fromEuler(0, M_PI / 2, M_PI / 2, {0, 0, 0})};  // to starboard
  for (const SE3& T_body_cam : mountings) {
    const Eigen::Vector3d forward = T_body_cam.rotation().conjugate() * Eigen::Vector3d::UnitX();
    for (double heading = -3; heading < 3.1; heading += 0.5)
      EXPECT_NEAR(headingOf(SE3::fromEuler(0.2, -0.3, heading, {0, 0, 0}) * T_body_cam, forward), heading,
                  1e-9);
  }
}

TEST(FixFactor, OfAnAntennaOnALeverHoldsWhenTheHeadingHasChangedSince) {
  constexpr double kSigma = 0.3, kLever = 3, kTurn = 0.2;  // [m], [m], [rad]
  const SE3 thought = camera(0, 0, 10, 0.4, 0), truth = camera(0, 0, 10, 0.4 + kTurn, 0);
  const Eigen::Vector3d lever(kLever, 0, -1);
  const Eigen::Vector2d fix = (truth * lever).head<2>();
  const RelativePose factor = fixFactor(kOrigin, kA, thought, thought, thought * lever, fix, kSigma);
  const Vector6d e = relativePoseError(factor, SE3(), truth);
  // What is left is of second order in the turn.
  const double left = kLever * kTurn * kTurn / 2 / kSigma;
  EXPECT_LT(e.dot(factor.information * e), 2 * left * left);
  const Vector6d before = relativePoseError(factor, SE3(), thought);
  const double all = kLever * kTurn / kSigma;
  EXPECT_NEAR(before.dot(factor.information * before), all * all, 0.1 * all * all);
}

TEST(LossOfTrack, OfAMinuteIsAsWideInSixtyStepsAsInOne) {
  const SensorNoise noise;
  LossOfTrack loss;
  double variance = 0;
  for (int second = 0; second < 60; ++second) {
    StepQuality quality{.seconds_unlocked = loss.add(1)};
    const double locked = stepSigma(0, {}, noise), unlocked = stepSigma(0, quality, noise);
    variance += unlocked * unlocked - locked * locked;
  }
  EXPECT_NEAR(std::sqrt(variance), 60 * noise.unknown_velocity, 1e-9);
  // Another loss starts from zero.
  EXPECT_EQ(loss.add(0), 0);
  EXPECT_EQ(loss.add(1), 1);
}

TEST(SoundShare, WidensTheScaleOfTheDvlUntilTheImagesHaveShownIt) {
  const SensorNoise noise;
  DvlCalibration calibration(noise);
  calibration.setSoundShare(0.025);
  EXPECT_NEAR(calibration.remainingShare(), std::hypot(0.025, noise.dvl_scale), 1e-12);
  // The instrument's 1500 m/s are 3 % too fast.
  StepQuality quality{.seconds = 1};
  const Matrix6d covariance = Matrix6d::Identity() * 1e-6;
  SE3 T_odom_a;
  for (int k = 0; k < 40; ++k) {
    const SE3 path(Eigen::Quaterniond::Identity(), {1, 0, 0});
    const SE3 T_odom_b = T_odom_a * path;
    EXPECT_TRUE(calibration.add(T_odom_a, T_odom_b, SE3(Eigen::Quaterniond::Identity(), {0.97, 0, 0}),
                                covariance, quality, 2));
    T_odom_a = T_odom_b;
  }
  // Of one range only: by the priors an eighth could be the rig's.
  EXPECT_NEAR(calibration.scale(), -0.0263, 0.002);
  EXPECT_NEAR(calibration.scale() + calibration.rangeError().dot(Eigen::Vector2d(1, 2)), -0.03, 0.001);
  EXPECT_EQ(calibration.restarts(), 0U);
  // A CTD begins to measure: dead reckoning's paths are scaled differently from now on.
  calibration.setSoundShare(0);
  EXPECT_EQ(calibration.scale(), 0);
  EXPECT_NEAR(calibration.covariance()(0, 0), noise.dvl_scale * noise.dvl_scale, 1e-15);
}

// Steps of 0.5 m over level ground 2 m below, which images see turned about its middle by what a metre of the
// path gives; attitude is read with noise.
struct CurvedSteps {
  static constexpr double kRange = 2, kPath = 0.5;  // [m]
  Eigen::Vector3d turn_per_m = Eigen::Vector3d::Zero();
  double noise = 0;  // of roll and pitch [rad]
  std::mt19937 random{7};

  void line(DvlCalibration& calibration, int steps) {
    const Eigen::Vector3d ground(-kPath / 2, 0, kRange);
    const auto at = [](const Eigen::Vector3d& place) { return SE3(Eigen::Quaterniond::Identity(), place); };
    Vector6d turn = Vector6d::Zero();
    turn.tail<3>() = kPath * turn_per_m;
    const SE3 path = at({kPath, 0, 0}), seen = path * at(ground) * SE3::exp(turn) * at(-ground);
    StepQuality quality{.seconds = 1};
    std::normal_distribution<double> normal(0, noise);
    const auto read = [&](double x) {
      Vector6d wrong = Vector6d::Zero();
      if (noise > 0) wrong.segment<2>(3) << normal(random), normal(random);
      return at({x, 0, 0}) * SE3::exp(wrong);
    };
    SE3 T_odom_a = read(0);
    for (int k = 1; k <= steps; ++k) {
      const SE3 T_odom_b = read(k * kPath);
      EXPECT_TRUE(calibration.add(T_odom_a, T_odom_b, seen, Matrix6d::Identity() * 1e-7, quality, kRange));
      T_odom_a = T_odom_b;
    }
  }
};

// A bowl makes images turn forwards, and be 1.6 % short; a twist makes them roll, and go astray by 1.6 %. The
// rig's ranges in the middle, and the DVL's mounting, are right.
TEST(DvlCalibration, TakesNoTurnByCurvedRangesForAnotherError) {
  constexpr double kCurl = 0.008;  // [rad/m]
  for (const double sign : {1.0, -1.0})
    for (const bool twist : {false, true}) {
      DvlCalibration calibration({}, kDvl);
      CurvedSteps steps;
      steps.turn_per_m = sign * kCurl * (twist ? Eigen::Vector3d(-1, 0, 0) : Eigen::Vector3d(0, 1, 0));
      steps.line(calibration, 60);
      EXPECT_NEAR(calibration.curl()(twist ? 1 : 0), sign * kCurl, 2e-4);
      EXPECT_NEAR(calibration.curl()(twist ? 0 : 1), 0, 2e-4);
      EXPECT_NEAR(calibration.rangeError().dot(Eigen::Vector2d(1, CurvedSteps::kRange)), 0, 4e-5);
      EXPECT_NEAR(calibration.scale(), 0, 8e-6);
      EXPECT_NEAR(calibration.heading(), 0, 4e-5);
      // What is seen without the turn is the path.
      Vector6d turn = Vector6d::Zero();
      turn.tail<3>() = steps.turn_per_m;
      const SE3 seen(SE3::exp(turn).rotation(), {1, 0, 0});
      EXPECT_LT(calibration.straightened(seen, 0).rotation().angularDistance(Eigen::Quaterniond::Identity()),
                2e-4);
    }
}

// A reading's error is taken back by the next step: the line measures by its length, ten times as well as its
// steps one by one.
TEST(DvlCalibration, ALineMeasuresCurvedRangesByItsLength) {
  constexpr double kCurl = 0.003;
  double chi2 = 0;
  constexpr int kDives = 40;
  for (int dive = 0; dive < kDives; ++dive) {
    const SensorNoise noise;
    DvlCalibration calibration(noise, kDvl);
    CurvedSteps steps{Eigen::Vector3d(0, kCurl, 0), noise.tilt, std::mt19937(dive + 1)};
    for (int line = 0; line < 4; ++line) steps.line(calibration, 15);
    const double sigma = calibration.curlSigma().x();
    EXPECT_LT(sigma, 4e-4);
    chi2 += std::pow((calibration.curl().x() - kCurl) / sigma, 2) / kDives;
  }
  EXPECT_GT(chi2, 0.4);
  EXPECT_LT(chi2, 1.8);
}

// A disparity that slopes over the image: in the camera's axes all ground seems tilted about the middle
// of the view, and turns with the vehicle.
TEST(DvlCalibration, TakesNoTiltedGroundForACurve) {
  constexpr double kRange = 2, kPath = 0.15, kTurn = 0.2, kTilted = 1e-3;  // [m], [m], [rad], [rad/m]
  constexpr int kLoops = 40, kSteps = 15;
  const SE3 ahead(Eigen::Quaterniond::Identity(), {0, 0, kRange});
  StepQuality quality{.seconds = 0.5, .turn = kTurn};
  const auto learnt = [&](const RigPrior& rig, const Eigen::Vector3d& tilt) {
    Vector6d tilts = Vector6d::Zero();
    tilts.tail<3>() = kRange * tilt;
    const SE3 seems = ahead * SE3::exp(tilts) * ahead.inverse();
    DvlCalibration calibration({}, kDvl, rig);
    SE3 T_odom_a;
    for (int k = 0; k < kLoops * kSteps; ++k) {
      Vector6d step = Vector6d::Zero();
      step.head<3>() = Eigen::Vector3d(0, -kPath, 0);
      step(5) = k / kSteps % 2 == 0 ? kTurn : -kTurn;
      const SE3 T_a_b = SE3::exp(step), T_odom_b = T_odom_a * T_a_b;
      EXPECT_TRUE(calibration.add(T_odom_a, T_odom_b, seems * T_a_b * seems.inverse(),
                                  Matrix6d::Identity() * 1e-7, quality, kRange));
      T_odom_a = T_odom_b;
    }
    return calibration;
  };
  RigPrior level{.ground_tilt = 0};
  for (const Eigen::Vector3d& tilt : {Eigen::Vector3d(kTilted, 0, 0), Eigen::Vector3d(0, kTilted, 0)}) {
    EXPECT_LT(learnt({}, tilt).curl().head<3>().norm(), 1.4e-4);
    EXPECT_GT(learnt(level, tilt).curl().head<3>().norm(), 1e-3);
  }
}

}  // namespace
}  // namespace fathom::slam
