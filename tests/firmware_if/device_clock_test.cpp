#include "firmware_if/devices/device_clock.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace fathom::io {
namespace {

constexpr std::int64_t kFirstStamp_ns = 1'700'000'000 * kSecond_ns;  // vehicle time

std::int64_t ns(double seconds) {
  return std::llround(seconds * 1e9);
}

// A device with a clock that is `offset_s` off and drifts, seven messages a second; they arrive late by a
// least delay and noise that only ever adds.
struct Device {
  double offset_s = -3600, ppm = 0, latency_s = 0.05, noise_s = 0.03;
  std::mt19937 random{7};
  std::int64_t stamp(double t) const {
    // As a DVL sends it: hundredths of a second, cut.
    const std::int64_t exact = kFirstStamp_ns + ns(t * (1 + ppm * 1e-6) + offset_s);
    return exact - exact % (kSecond_ns / 100);
  }
  std::int64_t arrival(double t) {
    return kFirstStamp_ns + ns(t + latency_s + std::exponential_distribution<double>(1 / noise_s)(random));
  }
};

TEST(DeviceClock, OffsetAndDriftOfAQuartzAreFollowedForHours) {
  for (const double ppm : {-100.0, 0.0, 100.0}) {
    Device device;
    device.ppm = ppm;
    DeviceClock clock({.latency_s = device.latency_s, .resolution_s = 0.01});
    double worst = 0, worst_step = 0, sum = 0, count = 0;
    std::int64_t before = 0;
    for (int i = 0; i < 7 * 3600 * 3; ++i) {
      const double t = i / 7.0;
      const std::int64_t arrival = device.arrival(t);
      const std::int64_t utc = clock.vehicleNs(device.stamp(t), arrival);
      EXPECT_LE(utc, arrival);
      if (t < 60) continue;
      const double error = static_cast<double>(utc - kFirstStamp_ns) / 1e9 - t;
      sum += error;
      ++count;
      worst = std::max(worst, std::abs(error));
      if (before != 0)
        worst_step = std::max(worst_step, std::abs(static_cast<double>(utc - before) / 1e9 - 1 / 7.0));
      before = utc;
    }
    EXPECT_LT(worst, 0.011) << ppm << " ppm: the stamps alone are cut to 0.01 s";
    EXPECT_NEAR(sum / count, 0, 0.005) << "what is left of the noise in a window's least";
    EXPECT_LT(worst_step, 0.02);
    // A clock that runs fast needs less and less to be added.
    EXPECT_NEAR(clock.rate() * 1e6, -ppm, 12);
    EXPECT_EQ(clock.leaps(), 0u);
    EXPECT_LT(clock.late(), 40u) << "one in 4000 of these";
    EXPECT_NEAR(clock.offset(), 3600 - 10800 * ppm * 1e-6, 0.02);
  }
}

TEST(DeviceClock, AStepOfTheClockIsNoticedInBothDirections) {
  for (const double leap : {-37.0, -2.0, 0.5, 37.0}) {
    Device device;
    DeviceClock clock({.latency_s = device.latency_s, .resolution_s = 0.01});
    double t = 0;
    for (; t < 60; t += 1 / 7.0) (void)clock.vehicleNs(device.stamp(t), device.arrival(t));
    device.offset_s += leap;
    for (int i = 0; t < 120; t += 1 / 7.0, ++i) {
      const std::int64_t arrival = device.arrival(t);
      const double utc =
          static_cast<double>(clock.vehicleNs(device.stamp(t), arrival) - kFirstStamp_ns) / 1e9;
      // Stamped by arrival for a moment, then by the clock again; never by the wrong time.
      EXPECT_LE(std::abs(utc - t), i < 40 ? 0.26 : 0.02) << "leap " << leap << ", message " << i;
    }
    EXPECT_EQ(clock.leaps(), 1u) << leap;
  }
}

TEST(DeviceClock, AMessageThatWasHeldUpMovesNothing) {
  Device device;
  device.noise_s = 0.002;
  DeviceClock clock({.latency_s = device.latency_s, .resolution_s = 0.01});
  for (int i = 0; i < 700; ++i) {
    const double t = i / 7.0;
    std::int64_t arrival = device.arrival(t);
    const bool held_up = i % 50 == 49;
    if (held_up) arrival += ns(0.2 + 0.02 * (i % 7));
    const double utc = static_cast<double>(clock.vehicleNs(device.stamp(t), arrival) - kFirstStamp_ns) / 1e9;
    if (i > 20 && !held_up) {
      EXPECT_NEAR(utc, t, 0.015);
    }
  }
  EXPECT_EQ(clock.leaps(), 0u);
}

TEST(DeviceClock, SameCallsSameResult) {
  Device a, b;
  DeviceClock first({}), second({});
  for (int i = 0; i < 1000; ++i)
    EXPECT_EQ(first.vehicleNs(a.stamp(i / 7.0), a.arrival(i / 7.0)),
              second.vehicleNs(b.stamp(i / 7.0), b.arrival(i / 7.0)));
}

}  // namespace
}  // namespace fathom::io
