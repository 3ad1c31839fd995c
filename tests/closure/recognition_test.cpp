#include "recon/closure/recognition.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/closure/seafloor.hpp"

namespace fathom::closure {
namespace {

using test::lookingDown;

// Two passes: frames 0 to 49 northwards, 100 to 149 eastwards across them, 0.5 m apart.
SE3 placeOf(int frame) {
  if (frame < 100) return lookingDown(0.5 * frame, 0, 0, 0);
  return lookingDown(10, 0.5 * (frame - 120), 0, 1.6);
}

RelativePrior odometry(int x, int y) {
  return {placeOf(x).inverse() * placeOf(y), 1e-4 * Matrix6d::Identity()};
}

Claim claimOf(int a, int b, int wanted = 3, double baseline = 0.4) {
  return {a, b, placeOf(a).inverse() * placeOf(b), 1e-4 * Matrix6d::Identity(), 50, wanted, baseline};
}

// The same, but the second pass 8 m from where it was.
Claim falseClaim(int a, int b) {
  Claim claim = claimOf(a, b);
  claim.T_a_b = placeOf(a).inverse() * (SE3::fromEuler(0, 0, 0, {8, 3, 0}) * placeOf(b));
  return claim;
}

TEST(Agreement, ThreeClaimsAroundOneCycleComeOutTogetherAndOnce) {
  Agreement agreement;
  EXPECT_TRUE(agreement.add(claimOf(20, 120), odometry).empty());
  EXPECT_TRUE(agreement.add(claimOf(21, 121), odometry).empty());
  const auto agreed = agreement.add(claimOf(19, 119), odometry);
  ASSERT_EQ(agreed.size(), 3U);
  EXPECT_EQ(agreed[2].a, 19);
  EXPECT_TRUE(agreement.waiting().empty());
  EXPECT_TRUE(agreement.add(claimOf(22, 122), odometry).empty());
}

TEST(Agreement, ClaimsOfOneFrameOrOfTheSamePairOrFarApartConfirmNothing) {
  Agreement of_one, of_the_other, same, far;
  for (int k = 0; k < 5; ++k) {
    EXPECT_TRUE(of_one.add(claimOf(20, 120 + k), odometry).empty());
    EXPECT_TRUE(of_the_other.add(claimOf(20 + k, 120), odometry).empty());
    EXPECT_TRUE(same.add(claimOf(20, 120), odometry).empty());
    EXPECT_TRUE(far.add(claimOf(10 * k, 100 + 10 * k), odometry).empty());
  }
}

TEST(Agreement, ClaimsFromPlacesTooNearEachOtherAreNotEnough) {
  Agreement agreement;
  for (int k = 0; k < 3; ++k) EXPECT_TRUE(agreement.add(claimOf(20 + k, 120 + k, 3, 1.2), odometry).empty());
  EXPECT_EQ(agreement.add(claimOf(23, 123, 3, 1.2), odometry).size(), 4U);
}

TEST(Agreement, FalseClaimsThatDifferStayUnconfirmedAndDoNotStopTrueOnes) {
  Agreement agreement;
  EXPECT_TRUE(agreement.add(falseClaim(20, 120), odometry).empty());
  EXPECT_TRUE(agreement.add(claimOf(19, 119), odometry).empty());
  Claim turned = falseClaim(21, 121);
  turned.T_a_b = turned.T_a_b * SE3::fromEuler(0, 0, 0.2, {0.3, 0, 0});
  EXPECT_TRUE(agreement.add(turned, odometry).empty());
  EXPECT_TRUE(agreement.add(claimOf(22, 122), odometry).empty());
  EXPECT_EQ(agreement.add(claimOf(18, 118), odometry).size(), 3U);
  EXPECT_EQ(agreement.waiting().size(), 2U);
}

TEST(Agreement, WhenFullTheOldestIsDroppedAndARemovedFramesClaimsToo) {
  Agreement agreement;
  for (std::size_t k = 0; k < Agreement::kWaiting + 10; ++k) {
    Claim alone = claimOf(20, 120);
    alone.a = 1000 * static_cast<int>(k);
    EXPECT_TRUE(agreement.add(alone, [](int, int) { return RelativePrior{}; }).empty());
  }
  EXPECT_EQ(agreement.waiting().size(), Agreement::kWaiting);
  EXPECT_EQ(agreement.forgotten(), 10U);
  agreement.remove(20000);
  EXPECT_EQ(agreement.waiting().size(), Agreement::kWaiting - 1);
}

TEST(Recognition, APoseThatTiltsTheGroundOrChangesTheDepthIsRefused) {
  const SE3 a = lookingDown(0, 0, 20, 0.3, 0.05, -0.03), b = lookingDown(0.4, 0.2, 20.2, 2.0);
  const SE3 T_a_b = a.inverse() * b;
  // Lost: another place and heading, but down and depth as they are.
  const SE3 lost = lookingDown(90, -40, 20.2, -1.1);
  EXPECT_TRUE(fitsDownAndDepth(a, lost, T_a_b));
  EXPECT_FALSE(fitsDownAndDepth(a, lookingDown(90, -40, 21.2, -1.1), T_a_b));
  EXPECT_FALSE(fitsDownAndDepth(a, lookingDown(90, -40, 20.2, -1.1, 0.15), T_a_b));
}

}  // namespace
}  // namespace fathom::closure
