#include "recon/closure/registration.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "tests/closure/seafloor.hpp"

namespace fathom::closure {
namespace {

using test::featuresOf;
using test::lookingDown;
using test::Seafloor;
using test::smallRig;

Seafloor rollingReef(std::uint32_t seed) {
  return {[](double n, double e) { return 2.0 + 0.10 * std::sin(2.1 * n + 0.3) * std::cos(1.7 * e); },
          test::randomTexture(0.006, seed)};
}

TEST(Registration, FindsTheRelativePoseOfTurnedAndShiftedFramesWithinMillimetres) {
  const Seafloor reef = rollingReef(1);
  const SE3 a = lookingDown(0, 0, 0, 0.1), b = lookingDown(0.35, -0.25, 0.08, 2.4, 0.05, -0.04);
  Registrar registrar(smallRig(), {});
  const Registration& r = registrar.process(featuresOf(reef, a, 1), featuresOf(reef, b, 2), std::nullopt);
  ASSERT_TRUE(r.accepted()) << nameOf(r.refusal);
  const Vector6d e = perturbation(r.T_a_b, a.inverse() * b);
  std::printf("%.2f mm, %.2f mrad off\n", 1e3 * e.head<3>().norm(), 1e3 * e.tail<3>().norm());
  EXPECT_LT(e.head<3>().norm(), 0.0066);  // twice what was measured
  EXPECT_LT(e.tail<3>().norm(), 0.0034);
  EXPECT_LT(e.dot(r.covariance.ldlt().solve(e)), 22.5);  // 99.9 % of chi-square with 6 degrees of freedom
}

TEST(Registration, RefusesFramesOfDifferentPlaces) {
  const Seafloor reef = rollingReef(1);
  Registrar registrar(smallRig(), {});
  const FrameFeatures a = featuresOf(reef, lookingDown(0, 0, 0, 0), 1);
  for (const double north : {6.0, 9.0, 14.0}) {
    const FrameFeatures b = featuresOf(reef, lookingDown(north, 3, 0, 0.4), 3);
    EXPECT_FALSE(registrar.process(a, b, std::nullopt).accepted());
  }
}

TEST(Registration, RefusesAPoseThatContradictsThePrior) {
  const Seafloor reef = rollingReef(2);
  const SE3 a = lookingDown(0, 0, 0, 0), b = lookingDown(0.3, 0.1, 0, 0.5);
  const FrameFeatures fa = featuresOf(reef, a, 1), fb = featuresOf(reef, b, 2);
  Registrar registrar(smallRig(), {});
  RelativePrior prior{a.inverse() * b, 0.0025 * Matrix6d::Identity()};
  EXPECT_TRUE(registrar.process(fa, fb, prior).accepted());
  prior.T_a_b = SE3(prior.T_a_b.rotation(), prior.T_a_b.translation() + Eigen::Vector3d(0.6, 0, 0));
  EXPECT_FALSE(registrar.process(fa, fb, prior).accepted());
  prior.covariance(2, 2) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(registrar.process(fa, fb, prior).refusal, Refusal::kContradiction);
}

TEST(Registration, RefusesFramesWithoutFeatures) {
  const FrameFeatures some = featuresOf(rollingReef(3), lookingDown(0, 0, 0, 0), 1);
  Registrar registrar(smallRig(), {});
  EXPECT_EQ(registrar.process(some, {}, std::nullopt).refusal, Refusal::kNoFeatures);
  EXPECT_EQ(registrar.process({}, {}, std::nullopt).refusal, Refusal::kNoFeatures);
}

TEST(Registration, GivesTheSameBytesTwice) {
  const Seafloor reef = rollingReef(4);
  const FrameFeatures a = featuresOf(reef, lookingDown(0, 0, 0, 0), 1);
  const FrameFeatures b = featuresOf(reef, lookingDown(0.3, 0.2, 0, 1.0), 2);
  Registrar first(smallRig(), {}), second(smallRig(), {});
  second.process(b, a, std::nullopt);
  const Registration r = first.process(a, b, std::nullopt);
  const Registration& s = second.process(a, b, std::nullopt);
  ASSERT_TRUE(r.accepted());
  EXPECT_EQ(r.T_a_b.translation(), s.T_a_b.translation());
  EXPECT_EQ(r.T_a_b.rotation().coeffs(), s.T_a_b.rotation().coeffs());
  EXPECT_EQ(r.covariance, s.covariance);
}

// `value` modulo `period`, 0 to `period`.
double within(double value, double period) {
  return value - period * std::floor(value / period);
}

// Grounds with different places that look the same follow: a false closure is worse than a missed one.

// Ripples of sand with crests along east, all alike: `own` is the part of the texture that is not repeated.
Seafloor ripples(double period, double own) {
  const auto repeated = test::randomTexture(0.006, 21), unique = test::randomTexture(0.006, 22);
  return {[period](double n, double) { return 2.0 + 0.02 * std::sin(2 * M_PI * n / period); },
          [=](double n, double e) {
            return (1 - own) * repeated(within(n, period), within(e, period)) + own * unique(n, e);
          }};
}

// Sand of its own everywhere, and two boulders that are copies of each other, `apart` to the north.
Seafloor twoBoulders(double radius, double apart) {
  const auto sand = test::randomTexture(0.006, 31), rock = test::randomTexture(0.006, 32);
  const auto local = [=](double n) { return n > apart / 2 ? n - apart : n; };
  return {
      [=](double n, double e) {
        const double r = std::hypot(local(n), e) / radius;
        return 2.0 - (r < 1 ? 0.25 * (1 - r * r) * (1 - r * r) : 0.0);
      },
      [=](double n, double e) { return std::hypot(local(n), e) < radius ? rock(local(n), e) : sand(n, e); }};
}

TEST(LookAlikes, RipplesThatRepeatGiveNoClosureBetweenDifferentPlaces) {
  Registrar registrar(smallRig(), {});
  for (const double own : {0.0, 0.3}) {
    for (const double period : {0.15, 0.4}) {
      const Seafloor sand = ripples(period, own);
      const FrameFeatures a = featuresOf(sand, lookingDown(0, 0, 0, 0), 1);
      ASSERT_GT(a.size(), 100U);
      // Whole periods away, so that the frames would fit each other; and a part of one.
      for (const double periods : {20.0, 30.3}) {
        const FrameFeatures b = featuresOf(sand, lookingDown(periods * period, 0.05, 0, 0.1), 2);
        const Registration& r = registrar.process(a, b, std::nullopt);
        EXPECT_FALSE(r.accepted()) << own << ' ' << period << ' ' << periods << ": " << r.inliers.size();
      }
    }
  }
}

TEST(LookAlikes, ABoulderThatLooksLikeAnotherGivesNoClosure) {
  Registrar registrar(smallRig(), {});
  for (const double radius : {0.3, 0.45}) {
    const Seafloor ground = twoBoulders(radius, 8);
    const FrameFeatures a = featuresOf(ground, lookingDown(0.05, 0.0, 0, 0), 1);
    const FrameFeatures b = featuresOf(ground, lookingDown(8.0, 0.1, 0, 0.5), 2);
    const Registration& r = registrar.process(a, b, std::nullopt);
    EXPECT_FALSE(r.accepted()) << radius << ": " << r.inliers.size() << " coverage " << r.coverage;
  }
}

TEST(LookAlikes, TheSameBoulderInTwoFramesIsAClosure) {
  const Seafloor ground = twoBoulders(0.45, 8);
  Registrar registrar(smallRig(), {});
  const SE3 a = lookingDown(0.05, 0.0, 0, 0), b = lookingDown(0.1, 0.2, 0, 0.5);
  const Registration& r = registrar.process(featuresOf(ground, a, 1), featuresOf(ground, b, 2), std::nullopt);
  ASSERT_TRUE(r.accepted()) << nameOf(r.refusal);
  EXPECT_LT((r.T_a_b.translation() - (a.inverse() * b).translation()).norm(), 0.02);
}

// At the images' edges the boulders fill the whole overlap that the frames would have: the prior of the path
// between must refuse them.
TEST(LookAlikes, LookAlikeBouldersAtTheEdgeAreRefusedByThePriorOfThePath) {
  const Seafloor ground = twoBoulders(0.3, 4);
  const SE3 a = lookingDown(-0.45, 0, 0, 0), b = lookingDown(4.45, 0, 0, 0);
  Matrix6d covariance = 0.0004 * Matrix6d::Identity();
  covariance(0, 0) = covariance(1, 1) = 0.25;  // half a metre
  Registrar registrar(smallRig(), {});
  EXPECT_FALSE(registrar
                   .process(featuresOf(ground, a, 1), featuresOf(ground, b, 2),
                            RelativePrior{a.inverse() * b, covariance})
                   .accepted());
}

}  // namespace
}  // namespace fathom::closure
