#include "firmware_if/devices/camera/camera_clock_map.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

using rt::seconds;

constexpr double kLeastReadingSigma_s = 1e-6;  // of a reading: nothing is latched better [s]
constexpr double kArrivalSigma_s = 0.5e-3;     // of a window's least delay [s]
constexpr double kArrivalWindow_s = 10;        // of arrivals that give one point [s]
constexpr std::int64_t kLeapNs = kSecond_ns;   // a clock so far off was reset
constexpr std::int64_t kBeforeExposureNs =
    50 * kMillisecond_ns;                                        // no frame comes so long before its exposure
constexpr int kLateFrames = 3;                                   // in a row, before it is the clock's doing
constexpr std::int64_t kReadingMarginNs = 20 * kMillisecond_ns;  // 200 ppm for 100 s
constexpr std::int64_t kSettlingUncertainty_ns =
    5 * kMillisecond_ns;  // a quarter of a pair's usual tolerance
constexpr int kSettlingArrivals = 5;
constexpr std::int64_t kLatestNs = std::int64_t{1} << 62;  // a damaged stamp; differences must not overflow
constexpr std::int64_t kTaiAheadNs = 37 * kSecond_ns;      // of UTC, since 2017

}  // namespace

void CameraClockMap::begin(std::int64_t device_ns, std::int64_t utc_ns) noexcept {
  any_ = true;
  has_readings_ = settled_ = false;
  arrivals_ = 0;
  device_base_ns_ = device_ns;
  offset_base_ns_ = utc_ns - device_ns;
  line_.restart();
  window_open_ = false;
  late_ = 0;
  reopened_ = false;
}

void CameraClockMap::reset(std::int64_t device_ns, std::int64_t utc_ns) noexcept {
  ++resets_;
  begin(device_ns, utc_ns);
}

std::int64_t CameraClockMap::lineUtcNs(std::int64_t device_ns) const noexcept {
  const double lag = line_.at(seconds(device_ns - device_base_ns_));
  return device_ns + offset_base_ns_ + rt::nanoseconds(lag);
}

// Largest distance of a reading from the line without a reset of the clock: the sum of both uncertainties. A
// line from arrivals is late by an unknown delay.
std::int64_t CameraClockMap::readingTolerance(std::int64_t uncertainty_ns) const noexcept {
  if (!has_readings_) return kLeapNs;
  double best = seconds(kLeapNs);
  for (std::size_t i = 0; i < line_.points().size(); ++i) best = std::min(best, line_.points()[i].sigma);
  return kReadingMarginNs + uncertainty_ns + rt::nanoseconds(best);
}

void CameraClockMap::addReading(std::int64_t device_ns, std::int64_t utc_ns,
                                std::int64_t uncertainty_ns) noexcept {
  device_ns = std::clamp<std::int64_t>(device_ns, 0, kLatestNs);
  uncertainty_ns = std::clamp<std::int64_t>(uncertainty_ns, 0, kLeapNs);
  if (!any_) {
    begin(device_ns, utc_ns);
  } else if ((any_device_ && device_ns < newest_device_ns_) ||
             std::abs(lineUtcNs(device_ns) - utc_ns) > readingTolerance(uncertainty_ns)) {
    any_device_ = false;  // the stamps restart with the clock
    reset(device_ns, utc_ns);
  }
  settled_ = settled_ || uncertainty_ns <= kSettlingUncertainty_ns;
  if (!has_readings_) {
    line_.forgetPoints();
    has_readings_ = true;
  }
  line_.add({seconds(device_ns - device_base_ns_), seconds(utc_ns - device_ns - offset_base_ns_),
             std::max(seconds(uncertainty_ns), kLeastReadingSigma_s)});
}

void CameraClockMap::noReadings() noexcept {
  if (!has_readings_) return;
  has_readings_ = settled_ = false;
  arrivals_ = 0;
  line_.forgetPoints();
}

void CameraClockMap::addArrival(std::int64_t device_ns, std::int64_t utc_ns) noexcept {
  const rt::ClockPoint point{seconds(device_ns - device_base_ns_),
                             seconds(utc_ns - device_ns - offset_base_ns_ - least_delay_ns_),
                             kArrivalSigma_s};
  if (!window_open_) {
    window_open_ = true;
    window_start_ = point.time;
    least_ = point;
  } else if (point.lag < least_.lag) {
    least_ = point;
  }
  // Before the first window is full its least so far stands for it.
  if (line_.points().empty()) line_.hold(least_.lag);
  if (point.time - window_start_ < kArrivalWindow_s) return;
  line_.add(least_);
  window_open_ = false;
}

bool CameraClockMap::timeOfDay(std::int64_t device_ns, std::int64_t utc_ns, std::int64_t utc_error_ns,
                               std::int64_t& mapped) const noexcept {
  for (const std::int64_t ahead : {std::int64_t{0}, kTaiAheadNs}) {
    mapped = device_ns - ahead + utc_error_ns;
    if (mapped - utc_ns < kBeforeExposureNs && utc_ns - mapped < kLeapNs) return true;
  }
  return false;
}

std::int64_t CameraClockMap::inOrder(std::int64_t utc_ns) noexcept {
  if (any_out_ && utc_ns <= newest_utc_ns_) {
    ++clamped_;
    utc_ns = newest_utc_ns_ + 1;
  }
  any_out_ = true;
  newest_utc_ns_ = utc_ns;
  return utc_ns;
}

// Compares an arrival with the line: notices that the clock was reset.
void CameraClockMap::watch(std::int64_t device_ns, std::int64_t utc_ns) noexcept {
  const std::int64_t lateness = utc_ns - lineUtcNs(device_ns);
  if (has_readings_) {
    // Packets come late, but never early: an early one shows a reset, which the next reading will confirm.
    if (lateness < -kBeforeExposureNs) settled_ = false;
    return;
  }
  // Until there is a line, one late frame may have set the offset, and the next shows it.
  const bool early = lateness < (line_.points().empty() ? -kLeapNs : -kBeforeExposureNs);
  late_ = reopened_ && lateness > kLeapNs ? late_ + 1 : 0;
  if (lateness <= kLeapNs) reopened_ = false;
  if (early || late_ == kLateFrames) reset(device_ns, utc_ns);
}

std::int64_t CameraClockMap::utcNs(std::int64_t device_ns, std::int64_t first_packet_utc_ns,
                                   std::int64_t utc_error_ns) noexcept {
  device_ns = std::clamp<std::int64_t>(device_ns, 0, kLatestNs);
  if (mode_ == Mode::kPtp) {
    std::int64_t mapped = 0;
    if (timeOfDay(device_ns, first_packet_utc_ns, utc_error_ns, mapped)) {
      settled_ = true;
      return inOrder(mapped);
    }
    ++unsynchronised_;
  }
  if (!any_) {
    begin(device_ns, first_packet_utc_ns);
  } else if (any_device_ && device_ns <= newest_device_ns_) {
    reset(device_ns, first_packet_utc_ns);
  } else {
    watch(device_ns, first_packet_utc_ns);
  }
  any_device_ = true;
  newest_device_ns_ = device_ns;
  if (!has_readings_) addArrival(device_ns, first_packet_utc_ns);
  if (!has_readings_ && ++arrivals_ >= kSettlingArrivals) settled_ = true;
  return inOrder(lineUtcNs(device_ns));
}

}  // namespace fathom::io
