#include "realtime/kernel/clock.hpp"

#include <cassert>
#include <cerrno>
#include <ctime>

namespace fathom::rt {
namespace {

constexpr std::int64_t kNsPerSecond = 1'000'000'000;

std::int64_t now(clockid_t id) noexcept {
  timespec time{};
  const int failed = ::clock_gettime(id, &time);
  assert(failed == 0);
  static_cast<void>(failed);
  return static_cast<std::int64_t>(time.tv_sec) * kNsPerSecond + time.tv_nsec;
}

}  // namespace

std::int64_t RealClock::monotonicNs() const noexcept {
  return now(CLOCK_MONOTONIC);
}
std::int64_t RealClock::utcNs() const noexcept {
  return now(CLOCK_REALTIME);
}

void RealClock::sleepUntil(std::int64_t monotonic_ns) noexcept {
  if (monotonic_ns <= 0) return;
  timespec time{};
  time.tv_sec = static_cast<time_t>(monotonic_ns / kNsPerSecond);
  time.tv_nsec = static_cast<long>(monotonic_ns % kNsPerSecond);
  // A signal ends the sleep early; the absolute time makes it safe to go on.
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr) == EINTR) {
  }
}

}  // namespace fathom::rt
