#pragma once

#include <cstdint>
#include <deque>

#include "realtime/base/units.hpp"

namespace fathom::monitor {

// Frames of the link over time, in steps of equal length. Bounded: when the steps are too many, pairs of them
// are joined; after a day without a frame, or a clock step of a day, it starts again.
class LinkHistory {
 public:
  struct Step {
    std::uint64_t bytes = 0;     // of accepted frames
    std::uint64_t accepted = 0;  // frames
    std::uint64_t rejected = 0;  // damaged, foreign or repeated frames
    std::int64_t lost = 0;       // frames; negative when late or repaired ones came after their step
  };
  static constexpr std::size_t kMaxSteps = 720;
  static constexpr std::int64_t kFirstStep_ns = 10'000'000'000;
  static constexpr std::int64_t kLongestSilence_ns = 86'400 * kSecond_ns;

  // Adds a frame received at `utc_ns`; `lost_so_far`: the receiver's count after it.
  void add(std::int64_t utc_ns, std::size_t bytes, bool accepted, std::uint64_t lost_so_far);

  // Over the steps that reach into the `window_s` before the newest.
  struct Recent {
    double rate_bps = 0;  // of accepted frames
    double loss = 0;      // share of the frames sent, 0 to 1; NaN: no frame
  };
  [[nodiscard]] Recent recent(double window_s, std::int64_t now_utc_ns) const;

  [[nodiscard]] std::int64_t start() const { return start_ns_; }  // UTC of the first step [ns]
  [[nodiscard]] std::int64_t step() const { return step_ns_; }    // length of a step [ns]
  [[nodiscard]] const std::deque<Step>& steps() const { return steps_; }

 private:
  std::int64_t start_ns_ = 0, step_ns_ = kFirstStep_ns;
  std::uint64_t lost_ = 0;
  std::deque<Step> steps_;
};

}  // namespace fathom::monitor
