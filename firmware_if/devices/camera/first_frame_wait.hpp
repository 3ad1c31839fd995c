#pragma once

#include <algorithm>
#include <cstdint>

#include "realtime/base/units.hpp"

namespace fathom::io {

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

}  // namespace fathom::io
