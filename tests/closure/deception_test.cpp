#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "recon/closure/registration.hpp"
#include "tests/closure/seafloor.hpp"

// Grounds made to deceive: different places that look the same. A false closure is worse than a missed one.
namespace fathom::closure {
namespace {

using test::lookingDown;
using test::Seafloor;
using test::smallRig;

FrameFeatures featuresOf(const Seafloor& seafloor, const SE3& T_nav_cam, std::uint32_t seed) {
  FeatureConfig config;
  config.max_features = 400;
  FeatureExtractor extractor(smallRig(), config);
  const auto images = test::shoot(seafloor, smallRig(), T_nav_cam, seed);
  return extractor.process(images.leftView(), images.rightView());
}

double within(double value, double period) {
  return value - period * std::floor(value / period);
}

// Ripples of sand with crests along east, each like the last: `own` is the part of the texture that is not
// repeated.
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

TEST(Deception, RipplesThatRepeatGiveNoClosureBetweenDifferentPlaces) {
  Registrar registrar(smallRig(), {});
  for (const double own : {0.0, 0.3}) {
    for (const double period : {0.15, 0.4}) {
      const Seafloor sand = ripples(period, own);
      const FrameFeatures a = featuresOf(sand, lookingDown(0, 0, 0, 0), 1);
      ASSERT_GT(a.size(), 100U);
      // Whole periods away, so that the frames would lie on each other; and a part of one.
      for (const double periods : {20.0, 30.3}) {
        const FrameFeatures b = featuresOf(sand, lookingDown(periods * period, 0.05, 0, 0.1), 2);
        const Registration& r = registrar.process(a, b, std::nullopt);
        EXPECT_FALSE(r.accepted()) << own << ' ' << period << ' ' << periods << ": " << r.inliers.size();
      }
    }
  }
}

TEST(Deception, ABoulderThatLooksLikeAnotherGivesNoClosure) {
  Registrar registrar(smallRig(), {});
  for (const double radius : {0.3, 0.45}) {
    const Seafloor ground = twoBoulders(radius, 8);
    const FrameFeatures a = featuresOf(ground, lookingDown(0.05, 0.0, 0, 0), 1);
    const FrameFeatures b = featuresOf(ground, lookingDown(8.0, 0.1, 0, 0.5), 2);
    const Registration& r = registrar.process(a, b, std::nullopt);
    EXPECT_FALSE(r.accepted()) << radius << ": " << r.inliers.size() << " coverage " << r.coverage;
  }
}

TEST(Deception, TheSameBoulderSeenTwiceIsAClosure) {
  const Seafloor ground = twoBoulders(0.45, 8);
  Registrar registrar(smallRig(), {});
  const SE3 a = lookingDown(0.05, 0.0, 0, 0), b = lookingDown(0.1, 0.2, 0, 0.5);
  const Registration& r = registrar.process(featuresOf(ground, a, 1), featuresOf(ground, b, 2), std::nullopt);
  ASSERT_TRUE(r.accepted()) << nameOf(r.refusal);
  EXPECT_LT((r.T_a_b.translation() - (a.inverse() * b).translation()).norm(), 0.02);
}

// At the images' edges the boulders fill all that the frames would share: what is known of the way between
// must tell.
TEST(Deception, LookAlikeBouldersAtTheEdgeAreRefusedByTheWayBetween) {
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
