#pragma once

#include <algorithm>
#include <cstdint>

#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock_line.hpp"

namespace fathom::io {

// A camera's own clock against the vehicle's time (UTC). With x the camera's stamp [s] since the first one,
//
//   utc = x + offset + drift * (x - x0)
//
// is fitted to the last ten minutes of points (x, utc - x) by least squares, with a prior of 0 +- 50 ppm on
// the drift, so that a short history cannot invent one. The points are, the better first:
//   readings  the camera's clock latched on command, half a round trip uncertain (addReading);
//   arrivals  a frame's first packet comes a delay after its stamp; the least of arrival less stamp over a
//   window
//             of frames is the offset plus the least delay.
// Once a reading came, arrivals only show leaps. Fixed memory; same calls, same result.
//
// A camera that starts again has its clock at zero. A stamp that goes back or a reading off the line begin a
// new line, and are counted; without readings so do a frame that came before its exposure, and three frames
// in a row more than a second late after reopened(). Lateness alone is the network's or the machine's.
class CameraClockMap {
 public:
  enum class Mode : std::uint8_t {
    kFree,  // the clock counts from power-on
    // The stamps are time of day by IEEE 1588, UTC or TAI. Corrected by vehicle time less UTC they are taken
    // while they fit the arrival; else they are fitted as kFree and counted.
    kPtp,
  };

  // `least_delay_ns`: known part of the least delay from stamp to first packet, 0 or more (arrivals only).
  explicit CameraClockMap(Mode mode = Mode::kFree, std::int64_t least_delay_ns = 0) noexcept
      : mode_(mode), least_delay_ns_(least_delay_ns) {}

  // The camera's clock showed `device_ns` at `utc_ns`, to within `uncertainty_ns`.
  void addReading(std::int64_t device_ns, std::int64_t utc_ns, std::int64_t uncertainty_ns) noexcept;
  // The camera cannot be read any more: arrivals count again.
  void noReadings() noexcept;
  // The camera was lost and found: its clock may have restarted.
  void reopened() noexcept { reopened_ = true; }
  // The vehicle's time of a frame's stamp, for frames in their order; later than every one before it.
  // `utc_error_ns`: vehicle time less UTC (kPtp only).
  [[nodiscard]] std::int64_t utcNs(std::int64_t device_ns, std::int64_t first_packet_utc_ns,
                                   std::int64_t utc_error_ns = 0) noexcept;

  // Whether the times are good enough for pairing: since the line began there was a close reading, or several
  // arrivals, of which the least late counts. One late packet must not set the clock.
  [[nodiscard]] bool settled() const noexcept { return settled_; }
  [[nodiscard]] std::uint64_t resets() const noexcept { return resets_; }
  // Times held back to stay in order.
  [[nodiscard]] std::uint64_t clamped() const noexcept { return clamped_; }
  [[nodiscard]] std::uint64_t unsynchronised() const noexcept { return unsynchronised_; }  // kPtp only
  // Seconds of the vehicle per second of the camera, less 1.
  [[nodiscard]] double drift() const noexcept { return line_.rate(); }
  [[nodiscard]] bool hasReadings() const noexcept { return has_readings_; }

 private:
  static constexpr double kDriftSigma = 50e-6;  // of free-running crystals
  void begin(std::int64_t device_ns, std::int64_t utc_ns) noexcept;
  void reset(std::int64_t device_ns, std::int64_t utc_ns) noexcept;
  void addArrival(std::int64_t device_ns, std::int64_t utc_ns) noexcept;
  void watch(std::int64_t device_ns, std::int64_t utc_ns) noexcept;
  [[nodiscard]] std::int64_t readingTolerance(std::int64_t uncertainty_ns) const noexcept;
  [[nodiscard]] std::int64_t lineUtcNs(std::int64_t device_ns) const noexcept;
  [[nodiscard]] std::int64_t inOrder(std::int64_t utc_ns) noexcept;
  [[nodiscard]] bool timeOfDay(std::int64_t device_ns, std::int64_t utc_ns, std::int64_t utc_error_ns,
                               std::int64_t& mapped) const noexcept;

  Mode mode_;
  std::int64_t least_delay_ns_;
  bool any_ = false, has_readings_ = false, any_out_ = false, any_device_ = false;
  std::int64_t device_base_ns_ = 0, offset_base_ns_ = 0;  // of the line's first point
  std::int64_t newest_device_ns_ = 0, newest_utc_ns_ = 0;
  rt::ClockLine line_{kDriftSigma};
  rt::ClockPoint least_;  // of the open window of arrivals
  double window_start_ = 0;
  bool window_open_ = false;
  bool settled_ = false;
  int arrivals_ = 0;  // since the line began, as far as they matter
  bool reopened_ = false;
  int late_ = 0;  // frames in a row that came far too late after the camera was opened again
  std::uint64_t resets_ = 0, clamped_ = 0, unsynchronised_ = 0;
};

// Decides when a free-running camera that was opened but sends no first frame is opened again. The wait
// doubles after each opening in vain, up to a minute, since a camera may begin late (warm-up, IEEE 1588). Not
// for cameras that wait for a trigger's edge.
class FirstFrameWait {
 public:
  static constexpr std::int64_t kLongestNs = 60 * kSecond_ns;

  // `first_ns`: some periods and a camera's start.
  constexpr explicit FirstFrameWait(std::int64_t first_ns) noexcept
      : first_ns_(first_ns), wait_ns_(first_ns) {}

  void opened(std::int64_t now_ns) noexcept {
    waits_ = true;
    opened_ns_ = now_ns;
  }
  void frameCame() noexcept {
    waits_ = false;
    wait_ns_ = first_ns_;
  }
  // True once an opening.
  [[nodiscard]] bool overdue(std::int64_t now_ns) noexcept {
    if (!waits_ || now_ns - opened_ns_ <= wait_ns_) return false;
    waits_ = false;
    wait_ns_ = std::min(2 * wait_ns_, std::max(kLongestNs, first_ns_));
    return true;
  }

 private:
  std::int64_t first_ns_, wait_ns_, opened_ns_ = 0;
  bool waits_ = false;
};

// Turns the frame ids of GigE Vision cameras into a number that only grows: 16-bit ids go 1, 2 ...
// 65535, 1 (0 is never used), 64-bit ids of GigE Vision 2 as they are.
//
// The time stamp, not the id, shows whether a frame is new. An id further from the one before than there can
// have been exposures is a jump: counting continues by one from there.
class FrameIdUnwrap {
 public:
  struct Step {
    std::uint64_t id = 0;      // grows by one an exposure
    std::uint64_t missed = 0;  // ids between the newest and this one that never came
    bool jumped = false;
  };

  // The id of a frame newer than every one before it. `most_missed`: more than so many cannot have been
  // exposed in between.
  [[nodiscard]] Step add(std::uint64_t device_id, std::uint64_t most_missed) noexcept {
    if (device_id > kLast16) wide_ = true;
    const std::uint64_t ahead = wide_ ? device_id - device_ : (device_id + kLast16 - device_) % kLast16;
    device_ = device_id;
    if (!any_ || restarted_) {
      // A camera that started again may count from any number; here the next number follows.
      newest_ = any_ ? newest_ + 1 : device_id;
      any_ = true;
      restarted_ = false;
      return {newest_, 0, false};
    }
    if (ahead == 0 || ahead - 1 > most_missed) return {++newest_, 0, true};
    newest_ += ahead;
    return {newest_, ahead - 1, false};
  }

  // The camera was started again: so were its ids.
  void restart() noexcept { restarted_ = true; }

 private:
  static constexpr std::uint64_t kLast16 = 65535;
  bool any_ = false, restarted_ = false, wide_ = false;
  std::uint64_t device_ = 0;  // newest as the device has it
  std::uint64_t newest_ = 0;
};

}  // namespace fathom::io
