#include "recon/navigation/dead_reckoning/camera_clock.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

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

}  // namespace
}  // namespace fathom::nav
