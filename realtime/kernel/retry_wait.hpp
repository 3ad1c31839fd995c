#pragma once

#include <algorithm>
#include <cstdint>

namespace fathom::rt {

// When to try again what failed: `first_ns` after the first failure, twice as long after each further one, at
// most `longest_ns`. Any clock that does not go back.
class RetryWait {
 public:
  constexpr RetryWait(std::int64_t first_ns, std::int64_t longest_ns) noexcept
      : first_ns_(first_ns), longest_ns_(longest_ns), wait_ns_(first_ns) {}

  // Whether it may be tried; at once, before anything failed.
  [[nodiscard]] bool due(std::int64_t now_ns) const noexcept { return now_ns >= next_ns_; }
  void failed(std::int64_t now_ns) noexcept {
    next_ns_ = now_ns + wait_ns_;
    wait_ns_ = std::min(2 * wait_ns_, longest_ns_);
  }
  void succeeded() noexcept {
    wait_ns_ = first_ns_;
    next_ns_ = INT64_MIN;
  }
  // What the next failure is waited for [ns].
  [[nodiscard]] std::int64_t waitNs() const noexcept { return wait_ns_; }

 private:
  std::int64_t first_ns_, longest_ns_, wait_ns_;
  std::int64_t next_ns_ = INT64_MIN;
};

}  // namespace fathom::rt
