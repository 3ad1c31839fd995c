// The fault points of the program under test (realtime/kernel/fault_point.hpp), as a BadPartsControl says.
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <stdexcept>

#include "realtime/base/units.hpp"
#include "realtime/kernel/fault_point.hpp"
#include "tests/support/bad_parts_control.hpp"
#include "tests/support/mapped_file.hpp"

namespace {

using fathom::kSecond_ns;
using fathom::test::BadPartsControl;
using fathom::test::mappedByEnvironment;
using fathom::test::nowNs;
using fathom::test::PartFault;

constexpr int kSlower = 10;

void sleepNs(std::int64_t ns) {
  timespec left = {ns / kSecond_ns, static_cast<long>(ns % kSecond_ns)};
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
      return sleepNs(kSecond_ns);
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
  static BadPartsControl* const of_environment = mappedByEnvironment<BadPartsControl>("FATHOM_BAD_PARTS");
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
    const bool slow = here && before_ns != 0 && nowNs() < all->until_ns;
    if (slow) sleepNs((kSlower - 1) * (now_ns - before_ns));
    before_ns = now_ns;
    if (slow) ++all->hit;
  } else if (here && all->hit++ == 0) {
    fail(fault);
  }
}

}  // extern "C"
