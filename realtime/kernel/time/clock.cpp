#include "realtime/kernel/time/clock.hpp"

#include <sys/timex.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <ctime>

#include "realtime/base/units.hpp"

namespace fathom::rt {
namespace {

std::int64_t now(clockid_t id) noexcept {
  timespec time{};
  const int failed = ::clock_gettime(id, &time);
  assert(failed == 0);
  static_cast<void>(failed);
  return static_cast<std::int64_t>(time.tv_sec) * kSecond_ns + time.tv_nsec;
}

}  // namespace

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

std::int64_t RealClock::monotonicNs() const noexcept {
  return now(CLOCK_MONOTONIC);
}
std::int64_t RealClock::utcNs() const noexcept {
  return now(CLOCK_REALTIME);
}

void RealClock::sleepUntil(std::int64_t monotonic_ns) noexcept {
  if (monotonic_ns <= 0) return;
  timespec time{};
  time.tv_sec = static_cast<time_t>(monotonic_ns / kSecond_ns);
  time.tv_nsec = static_cast<long>(monotonic_ns % kSecond_ns);
  // A signal ends the sleep early; the absolute time makes it safe to repeat.
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr) == EINTR) {
  }
}

SystemClockState readSystemClock() noexcept {
  timex clock = {};
  const int state = ::adjtimex(&clock);
  if (state < 0) return {};
  return {true, state != TIME_ERROR && (clock.status & STA_UNSYNC) == 0, (clock.status & STA_PPSSIGNAL) != 0,
          static_cast<double>(clock.maxerror) / 1e6};
}

}  // namespace fathom::rt
