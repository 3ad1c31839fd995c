#include "recon/compare/surface_registration.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "recon/compare/difference.hpp"
#include "tests/compare/synthetic_terrain.hpp"

namespace fathom::compare {
namespace {

using test::mapOf;
using test::roughHeight;

constexpr Box kSurvey{-10, -8, 10, 8};
constexpr Box kReference{-18, -16, 18, 16};
constexpr double kCell = 0.25;

TEST(SurfaceRegistration, FindsAKnownShiftWithinItsOwnUncertainty) {
  // The survey is 1.37 m too far west and 0.62 m too far north of the truth, and 0.8 m too high.
  const HeightMap survey = mapOf(
      kSurvey, kCell, [](double e, double n) { return roughHeight(e + 1.37, n - 0.62) + 0.8; }, 0.02, 1);
  const HeightMap reference = mapOf(kReference, kCell, roughHeight, 0.03, 2);
  const SurfaceRegistration r = registerMaps(survey, reference, {});
  ASSERT_EQ(r.directions_resolved, 2);
  const Eigen::Vector3d truth(1.37, -0.62, -0.8);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(r.offset.shift[k], truth[k], 4 * r.sigma[k] + 0.002) << k;
    EXPECT_LT(r.sigma[k], 0.02) << k;
    EXPECT_GT(r.sigma[k], 1e-5) << k;
  }
  EXPECT_GT(r.correlation, 0.95);
  EXPECT_FALSE(r.at_limit);
}

TEST(SurfaceRegistration, ItsUncertaintyIsThatOfItsErrorOverManyNoises) {
  constexpr int kRuns = 30;
  double squares = 0;
  for (std::uint64_t run = 0; run < kRuns; ++run) {
    const HeightMap survey = mapOf(
        kSurvey, 0.5, [](double e, double n) { return roughHeight(e + 0.3, n); }, 0.04, 2 * run + 10);
    const HeightMap reference = mapOf(kReference, 0.5, roughHeight, 0.04, 2 * run + 11);
    const SurfaceRegistration r = registerMaps(survey, reference, {.max_shift = 2});
    ASSERT_EQ(r.directions_resolved, 2);
    squares += std::pow((r.offset.shift.x() - 0.3) / r.sigma.x(), 2);
  }
  const double ratio = std::sqrt(squares / kRuns);
  EXPECT_GT(ratio, 0.6);
  EXPECT_LT(ratio, 1.6);
}

TEST(SurfaceRegistration, LeavesTheHorizontalOffsetOfAFlatNoisySeafloorUnresolved) {
  const auto flat = [](double, double) { return -12.0; };
  const HeightMap survey = mapOf(
      kSurvey, kCell, [](double, double) { return -11.5; }, 0.03, 3);
  const HeightMap reference = mapOf(kReference, kCell, flat, 0.03, 4);
  const SurfaceRegistration r = registerMaps(survey, reference, {});
  EXPECT_EQ(r.directions_resolved, 0);
  EXPECT_EQ(r.offset.shift.x(), 0);
  EXPECT_EQ(r.offset.shift.y(), 0);
  EXPECT_TRUE(std::isinf(r.sigma.x()));
  EXPECT_NEAR(r.offset.shift.z(), -0.5, 0.005);
  EXPECT_NE(r.note.find("too flat"), std::string::npos);
}

TEST(SurfaceRegistration, HoldsTheOffsetAlongParallelRipples) {
  // Crests run along bearing 30 degrees.
  const auto ripples = [](double e, double n) {
    const double across = e * std::cos(std::numbers::pi / 6) - n * std::sin(std::numbers::pi / 6);
    return -9 + 0.2 * std::sin(0.8 * across) + 0.1 * std::sin(1.9 * across + 1) +
           0.15 * std::sin(0.33 * across);
  };
  const double moved = 0.7;  // across the crests [m]
  const HeightMap survey = mapOf(
      kSurvey, kCell,
      [&](double e, double n) {
        return ripples(e + moved * std::cos(std::numbers::pi / 6),
                       n - moved * std::sin(std::numbers::pi / 6));
      },
      0.01, 5);
  const HeightMap reference = mapOf(kReference, kCell, ripples, 0.01, 6);
  const SurfaceRegistration r = registerMaps(survey, reference, {.max_shift = 3});
  ASSERT_EQ(r.directions_resolved, 1);
  EXPECT_NEAR(r.open_bearing, std::numbers::pi / 6, 0.1);
  const Eigen::Vector2d across(std::cos(std::numbers::pi / 6), -std::sin(std::numbers::pi / 6));
  EXPECT_NEAR(r.offset.shift.head<2>().dot(across), moved, 0.02);
}

TEST(SurfaceRegistration, IsRobustToATenthOfWrongHeights) {
  HeightMap survey = mapOf(
      kSurvey, kCell, [](double e, double n) { return roughHeight(e - 0.9, n + 0.4); }, 0.01, 7);
  for (std::size_t i = 0; i < survey.up.size(); i += 10) survey.up[i] += 1.5F;
  const HeightMap reference = mapOf(kReference, kCell, roughHeight, 0.01, 8);
  const SurfaceRegistration r = registerMaps(survey, reference, {});
  ASSERT_EQ(r.directions_resolved, 2);
  EXPECT_NEAR(r.offset.shift.x(), -0.9, 0.01);
  EXPECT_NEAR(r.offset.shift.y(), 0.4, 0.01);
  EXPECT_NEAR(r.offset.shift.z(), 0.0, 0.01);
}

TEST(SurfaceRegistration, FindsATiltWhenAskedFor) {
  const HeightMap survey = mapOf(
      kSurvey, kCell, [](double e, double n) { return roughHeight(e + 0.5, n) - 0.02 * e + 0.01 * n; }, 0.01,
      9);
  const HeightMap reference = mapOf(kReference, kCell, roughHeight, 0.01, 10);
  const SurfaceRegistration r = registerMaps(survey, reference, {.max_shift = 2, .tilt = true});
  ASSERT_EQ(r.directions_resolved, 2);
  EXPECT_NEAR(r.offset.tilt.x(), 0.02, 0.001);
  EXPECT_NEAR(r.offset.tilt.y(), -0.01, 0.001);
  EXPECT_NEAR(r.offset.shift.x(), 0.5, 0.02);
}

TEST(Difference, HasItsStatisticsBySlopeAndByStatedSigma) {
  HeightMap survey = mapOf(kSurvey, kCell, roughHeight, 0.0, 0);
  survey.sigma.assign(survey.up.size(), 0.01F);
  for (int row = 0; row < survey.rows; ++row)
    for (int column = 0; column < survey.columns; ++column) {
      // Half of the cells are claimed to be, and are, five times as uncertain.
      const std::size_t at = survey.index(column, row);
      if (column % 2 == 0) survey.sigma[at] = 0.05F;
      survey.up[at] +=
          static_cast<float>(static_cast<double>(survey.sigma[at]) * test::noiseAt(column, row, 11)) + 0.1F;
    }
  const HeightMap reference = mapOf(kReference, kCell, roughHeight, 0.0, 0);
  RegistrationOffset offset;
  offset.shift.z() = -0.1;
  const Difference d = differenceOf(survey, reference, offset);
  EXPECT_EQ(d.after.cells, survey.up.size());
  EXPECT_NEAR(d.before.bias, 0.1, 0.002);
  EXPECT_NEAR(d.after.bias, 0.0, 0.002);
  EXPECT_NEAR(d.after.rms, std::sqrt(0.5 * (0.01 * 0.01 + 0.05 * 0.05)), 0.003);
  ASSERT_EQ(d.by_sigma.size(), 4U);
  for (const DifferenceClass& k : d.by_sigma) EXPECT_NEAR(k.rms_over_sigma, 1.0, 0.1);
  std::size_t by_slope = 0;
  for (const DifferenceClass& k : d.by_slope) by_slope += k.statistics.cells;
  EXPECT_EQ(by_slope, d.after.cells);
  EXPECT_GT(d.by_slope.size(), 2U);
  EXPECT_NEAR(d.overlap_m2, 20 * 16, 1);
}

}  // namespace
}  // namespace fathom::compare
