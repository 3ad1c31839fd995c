#pragma once

#include <cstdint>

#include "realtime/kernel/time/clock_line.hpp"

namespace fathom::nav {

// Follows a camera's clock against the vehicle's, which is UTC, by when its images arrive. An image arrives a
// delay after its exposure that is never less than some least one; so the least of arrival less stamp over a
// few images shows what the camera's clock has gained or lost since the first images, of known offset.
// Free-running camera clocks are up to 100 ppm off: 1.8 s in five hours, a metre of path.
//
// A line is fitted to the least differences of the last 64 windows, ten
// minutes at 2 Hz. Fixed memory; same calls, same result.
class CameraClock {
 public:
  // The stamp [ns] in the vehicle's time, for an image that arrived then
  // (vehicle's clock). Images come in their order.
  [[nodiscard]] std::int64_t utcNs(std::int64_t stamp_ns, std::int64_t arrival_utc_ns) noexcept;

  // What the camera's clock has lost since the first images, as last seen [s]; and how fast [s/s].
  [[nodiscard]] double lost() const noexcept { return lost_; }
  [[nodiscard]] double rate() const noexcept { return line_.rate(); }
  // Number of its leaps: set again, or a camera that was restarted.
  [[nodiscard]] std::uint64_t leaps() const noexcept { return leaps_; }

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) {
    archive(self.first_stamp_ns_, self.base_ns_, self.any_, self.based_, self.in_window_, self.least_,
            self.line_, self.lost_, self.start_, self.leapt_, self.leaps_);
    archive.require(self.in_window_ >= 0 && self.in_window_ < kWindow, "a clock's window is too long");
  }

 private:
  static constexpr int kWindow = 20;         // images that give one least difference
  static constexpr std::size_t kFewest = 3;  // before there is a line
  void close() noexcept;

  std::int64_t first_stamp_ns_ = 0, base_ns_ = 0;  // base: least arrival less stamp of the first window
  bool any_ = false, based_ = false;
  int in_window_ = 0;
  rt::ClockPoint least_;  // arrival less stamp, of the present window
  rt::ClockLine line_;
  double lost_ = 0;
  double start_ = 0, leapt_ = 0;  // of the line at the first image; sum of leaps [s]
  std::uint64_t leaps_ = 0;
};

}  // namespace fathom::nav
