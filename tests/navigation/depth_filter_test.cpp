#include "recon/navigation/dead_reckoning/depth_filter.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace fathom::nav {
namespace {

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

}  // namespace
}  // namespace fathom::nav
