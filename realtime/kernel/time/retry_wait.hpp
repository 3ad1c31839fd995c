#pragma once

#include <algorithm>
#include <cstdint>

namespace fathom::rt {

// Exponential back-off: the wait before the next try is `first_ns` after the first failure and doubles with
// each further one, up to `longest_ns`. Any clock that does not run backwards.
class RetryWait {
 public:
  constexpr RetryWait(std::int64_t first_ns, std::int64_t longest_ns) noexcept
      : first_ns_(first_ns), longest_ns_(longest_ns), wait_ns_(first_ns) {}

  // Whether it may be tried; true before any failure.
  [[nodiscard]] bool due(std::int64_t now_ns) const noexcept { return now_ns >= next_ns_; }
  void failed(std::int64_t now_ns) noexcept {
    next_ns_ = now_ns + wait_ns_;
    wait_ns_ = std::min(2 * wait_ns_, longest_ns_);
  }
  void succeeded() noexcept {
    wait_ns_ = first_ns_;
    next_ns_ = INT64_MIN;
  }

 private:
  std::int64_t first_ns_, longest_ns_, wait_ns_;
  std::int64_t next_ns_ = INT64_MIN;
};

}  // namespace fathom::rt
