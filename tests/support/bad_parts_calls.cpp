// The fault points of the program under test (realtime/kernel/fault_point.hpp), as a BadPartsControl says.
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <stdexcept>

#include "realtime/kernel/fault_point.hpp"
#include "tests/support/bad_parts_control.hpp"

namespace {

using fathom::test::BadPartsControl;
using fathom::test::PartFault;

constexpr std::int64_t kSecond = 1'000'000'000;  // [ns]
constexpr int kSlower = 10;

BadPartsControl* controlOfEnvironment() {
  const char* path = ::getenv("FATHOM_BAD_PARTS");
  if (path == nullptr) return nullptr;
  // Past the calls that a bad disk spoils.
  const long fd = ::syscall(SYS_openat, AT_FDCWD, path, O_RDWR | O_CLOEXEC, 0);
  if (fd < 0) return nullptr;
  void* memory =
      ::mmap(nullptr, sizeof(BadPartsControl), PROT_READ | PROT_WRITE, MAP_SHARED, static_cast<int>(fd), 0);
  ::syscall(SYS_close, fd);
  return memory == MAP_FAILED ? nullptr : static_cast<BadPartsControl*>(memory);
}

std::int64_t nowNs(clockid_t clock) {
  timespec now = {};
  ::clock_gettime(clock, &now);
  return now.tv_sec * kSecond + now.tv_nsec;
}

void sleepNs(std::int64_t ns) {
  timespec left = {ns / kSecond, static_cast<long>(ns % kSecond)};
  while (::nanosleep(&left, &left) != 0) continue;
}

void fail(PartFault fault) {
  switch (fault) {
    case PartFault::kThrow:
      throw std::runtime_error("a fault of a test");
    case PartFault::kAbort:
      ::abort();
    case PartFault::kSegmentation:
      ::raise(SIGSEGV);
      return;
    case PartFault::kKill:
      ::kill(::getpid(), SIGKILL);
      return;
    case PartFault::kHangShort:
      return sleepNs(kSecond);
    case PartFault::kHang:
      for (;;) ::pause();
    case PartFault::kNone:
    case PartFault::kSlow:
    case PartFault::kCorrupt:
      return;
  }
}

}  // namespace

extern "C" {

fathom::test::BadPartsControl* fathomBadParts() {
  static BadPartsControl* const of_environment = controlOfEnvironment();
  return of_environment;
}

void fathomFaultPoint(const char* part) {
  BadPartsControl* const all = fathomBadParts();
  if (all == nullptr) return;
  const PartFault fault = all->fault;
  if (fault == PartFault::kNone) return;
  const bool here = ::strcmp(all->part, part) == 0;
  if (fault == PartFault::kSlow) {
    // Of its thread, since the point that it last came by.
    thread_local std::int64_t before_ns = 0;
    const std::int64_t now_ns = nowNs(CLOCK_THREAD_CPUTIME_ID);
    const bool slow = here && before_ns != 0 && nowNs(CLOCK_MONOTONIC) < all->until_ns;
    if (slow) sleepNs((kSlower - 1) * (now_ns - before_ns));
    before_ns = now_ns;
    if (slow) ++all->hit;
  } else if (here && all->hit++ == 0) {
    fail(fault);
  }
}

}  // extern "C"
