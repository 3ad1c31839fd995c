#include "recon/products/rasters/terrain.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace fathom::topside {
namespace {

struct Field {
  std::vector<float> elevation;
  TerrainView view;
  // Elevation [m] of north and east [m] from the view's first cell.
  template <typename F>
  Field(int rows, int columns, int halo, double cell, F&& up) {
    for (int i = -halo; i < rows + halo; ++i)
      for (int j = -halo; j < columns + halo; ++j)
        elevation.push_back(static_cast<float>(up(i * cell, j * cell)));
    view = {elevation.data(), rows, columns, halo, cell};
  }
};

TEST(Terrain, APlanesSlopeAndAspectAreItsOwn) {
  for (const double aspect : {0.0, 35.0, 90.0, 200.0, 315.0}) {
    const double fall = std::tan(20 * kRadiansPerDegree);
    Field field(40, 50, 4, 0.033, [&](double n, double e) {
      return -3000 -
             fall * (n * std::cos(aspect * kRadiansPerDegree) + e * std::sin(aspect * kRadiansPerDegree));
    });
    const SlopeAspect result = slopeAspect(field.view, {4, 0.5});
    for (std::size_t k = 0; k < result.slope.size(); ++k) {
      ASSERT_NEAR(result.slope[k], 20, 0.05) << aspect;
      const double difference = std::remainder(static_cast<double>(result.aspect[k]) - aspect, 360.0);
      ASSERT_NEAR(difference, 0, 0.1) << aspect;
      ASSERT_GE(result.aspect[k], 0);
      ASSERT_LT(result.aspect[k], 360);
    }
    for (const float r : rugosity(field.view, {4, 0.5}))
      ASSERT_NEAR(r, 1, 5e-4);  // single precision 3 km down
  }
}

TEST(Terrain, LevelGroundHasNoAspect) {
  Field field(8, 8, 1, 0.1, [](double, double) { return -12; });
  const SlopeAspect result = slopeAspect(field.view, {1, 0.5});
  for (const float s : result.slope) EXPECT_EQ(s, 0);
  for (const float a : result.aspect) EXPECT_TRUE(std::isnan(a));
}

// Length of z = A sin(k x) over a wave, by fine steps.
double waveLength(double amplitude, double wave) {
  double length = 0;
  constexpr int kSteps = 100'000;
  for (int i = 0; i < kSteps; ++i) {
    const double slope =
        amplitude * 2 * std::numbers::pi / wave * std::cos(2 * std::numbers::pi * (i + 0.5) / kSteps);
    length += std::sqrt(1 + slope * slope) * wave / kSteps;
  }
  return length / wave;
}

TEST(Terrain, ACorrugatedSurfacesRugosityIsTheLengthOfItsWaves) {
  constexpr double kCell = 0.01, kWave = 0.4;
  for (const double amplitude : {0.02, 0.05, 0.10}) {
    for (const double tilt : {0.0, 0.3}) {
      Field field(60, 60, 60, kCell, [&](double n, double e) {
        return amplitude * std::sin(2 * std::numbers::pi * n / kWave) + tilt * e;
      });
      // A window of three waves between its outer cells' middles.
      const std::vector<float> result = rugosity(field.view, {60, 0.5});
      // Along the waves' crests the tilt makes surface and projection longer alike, across it the waves
      // are less steep against the tilted plane: by the mean over a wave of the true area.
      double area = 0;
      constexpr int kSteps = 20'000;
      for (int i = 0; i < kSteps; ++i) {
        const double slope =
            amplitude * 2 * std::numbers::pi / kWave * std::cos(2 * std::numbers::pi * (i + 0.5) / kSteps);
        area += std::sqrt(1 + slope * slope + tilt * tilt) / kSteps;
      }
      const double expected = area / std::sqrt(1 + tilt * tilt);
      if (tilt == 0) {
        ASSERT_NEAR(expected, waveLength(amplitude, kWave), 1e-6);
      }
      // The plane of best fit of a whole number of sine waves leans a little with their phase.
      for (const float r : result) ASSERT_NEAR(r, expected, 0.012 * expected) << amplitude << ' ' << tilt;
    }
  }
}

TEST(Terrain, UnknownCellsAreLeftOutAndTooFewGiveNothing) {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  Field field(20, 20, 3, 0.05, [](double n, double e) { return -5 + 0.2 * n + 0.1 * e; });
  std::mt19937 random(4);
  for (std::size_t k = 0; k < field.elevation.size(); k += 1 + random() % 4) field.elevation[k] = kNaN;
  for (int i = 0; i < 26 * 10; ++i) field.elevation[static_cast<std::size_t>(i)] = kNaN;  // the southern part
  const SlopeAspect result = slopeAspect(field.view, {3, 0.4});
  const std::vector<float> rough = rugosity(field.view, {3, 0.4});
  int known = 0;
  const double slope = std::atan(std::hypot(0.2, 0.1)) / kRadiansPerDegree;
  for (int i = 0; i < 20; ++i) {
    for (int j = 0; j < 20; ++j) {
      const auto k = static_cast<std::size_t>(i * 20 + j);
      EXPECT_TRUE(i >= 6 || std::isnan(result.slope[k])) << i;
      if (std::isnan(result.slope[k])) continue;
      ++known;
      EXPECT_NEAR(result.slope[k], slope, 0.01);
      EXPECT_TRUE(std::isnan(rough[k]) || std::abs(rough[k] - 1) < 1e-4) << rough[k];
    }
  }
  EXPECT_GT(known, 50);
  Field nothing(5, 5, 2, 0.1, [&](double, double) { return kNaN; });
  for (const float v : slopeAspect(nothing.view, {2, 0.5}).slope) EXPECT_TRUE(std::isnan(v));
  for (const float v : rugosity(nothing.view, {2, 0.5})) EXPECT_TRUE(std::isnan(v));
}

TEST(Terrain, AWindowIsAtLeastThreeCellsWide) {
  EXPECT_EQ(radiusOf(0.25, 0.033), 4);
  EXPECT_EQ(radiusOf(1.0, 0.033), 15);
  EXPECT_EQ(radiusOf(0.3, 0.1), 1);
  EXPECT_EQ(radiusOf(0.01, 0.033), 1);
}

}  // namespace
}  // namespace fathom::topside
