#include "recon/closure/registration.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "tests/closure/seafloor.hpp"

namespace fathom::closure {
namespace {

using test::lookingDown;
using test::Seafloor;
using test::smallRig;

Seafloor rollingReef(std::uint32_t seed) {
  return {[](double n, double e) { return 2.0 + 0.10 * std::sin(2.1 * n + 0.3) * std::cos(1.7 * e); },
          test::randomTexture(0.006, seed)};
}

FrameFeatures featuresOf(const Seafloor& seafloor, const SE3& T_nav_cam, std::uint32_t noise_seed,
                         DescriptorKind kind = DescriptorKind::kRootSift) {
  FeatureConfig config;
  config.kind = kind;
  config.max_features = 400;
  FeatureExtractor extractor(smallRig(), config);
  const auto images = test::shoot(seafloor, smallRig(), T_nav_cam, noise_seed);
  return extractor.process(images.leftView(), images.rightView());
}

Vector6d errorOf(const Registration& r, const SE3& truth) {
  const SE3 d = r.T_a_b.inverse() * truth;
  const Eigen::AngleAxisd turn(d.rotation());
  Vector6d e;
  e << d.translation(), wrapAngle(turn.angle()) * turn.axis();
  return e;
}

TEST(Registration, FindsTheRelativePoseOfTurnedAndShiftedFramesWithinMillimetres) {
  const Seafloor reef = rollingReef(1);
  const SE3 a = lookingDown(0, 0, 0, 0.1), b = lookingDown(0.35, -0.25, 0.08, 2.4, 0.05, -0.04);
  Registrar registrar(smallRig(), {});
  const Registration& r = registrar.process(featuresOf(reef, a, 1), featuresOf(reef, b, 2), std::nullopt);
  ASSERT_TRUE(r.accepted()) << nameOf(r.refusal);
  const Vector6d e = errorOf(r, a.inverse() * b);
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

TEST(Registration, RefusesAPoseThatContradictsWhatIsKnown) {
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

TEST(Registration, RefusesFramesWithoutFeaturesAndOfDifferentKinds) {
  const Seafloor reef = rollingReef(3);
  const FrameFeatures sift = featuresOf(reef, lookingDown(0, 0, 0, 0), 1);
  const FrameFeatures orb = featuresOf(reef, lookingDown(0, 0, 0, 0), 1, DescriptorKind::kOrb);
  Registrar registrar(smallRig(), {});
  EXPECT_EQ(registrar.process(sift, {}, std::nullopt).refusal, Refusal::kNoFeatures);
  EXPECT_EQ(registrar.process({}, {}, std::nullopt).refusal, Refusal::kNoFeatures);
  EXPECT_EQ(registrar.process(sift, orb, std::nullopt).refusal, Refusal::kNoFeatures);
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

class EveryDescriptor : public testing::TestWithParam<DescriptorKind> {};

TEST_P(EveryDescriptor, RegistersFramesThatShareMostOfTheirView) {
  const Seafloor reef = rollingReef(5);
  const SE3 a = lookingDown(0, 0, 0, 0), b = lookingDown(0.15, 0.1, 0, 0.3);
  Registrar registrar(smallRig(), {});
  const Registration& r =
      registrar.process(featuresOf(reef, a, 1, GetParam()), featuresOf(reef, b, 2, GetParam()), std::nullopt);
  ASSERT_TRUE(r.accepted()) << nameOf(r.refusal);
  EXPECT_LT(errorOf(r, a.inverse() * b).head<3>().norm(), 0.012);
}

INSTANTIATE_TEST_SUITE_P(Kinds, EveryDescriptor,
                         testing::Values(DescriptorKind::kRootSift, DescriptorKind::kOrb,
                                         DescriptorKind::kAkaze, DescriptorKind::kBrisk));

}  // namespace
}  // namespace fathom::closure
