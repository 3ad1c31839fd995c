#include "realtime/kernel/time/periodic_loop.hpp"

#include <algorithm>
#include <cassert>

namespace fathom::rt {

PeriodicLoop::PeriodicLoop(Clock& clock, std::int64_t period_ns) noexcept
    : clock_(clock), period_ns_(period_ns), deadline_ns_(clock.monotonicNs() + period_ns) {
  assert(period_ns > 0);
}

void PeriodicLoop::finish(std::int64_t begin_ns, std::int64_t end_ns) noexcept {
  ++statistics_.cycles;
  statistics_.jitter_ns.add(begin_ns - deadline_ns_);
  statistics_.body_ns.add(end_ns - begin_ns);
  statistics_.max_body_ns = std::max(statistics_.max_body_ns, end_ns - begin_ns);

  deadline_ns_ += period_ns_;
  if (end_ns > deadline_ns_) {
    const std::int64_t missed = (end_ns - deadline_ns_ + period_ns_ - 1) / period_ns_;
    statistics_.skipped_cycles += static_cast<std::uint64_t>(missed);
    deadline_ns_ += missed * period_ns_;
  }
}

}  // namespace fathom::rt
