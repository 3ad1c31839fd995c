#include "realtime/kernel/system_clock.hpp"

#include <sys/timex.h>

namespace fathom::rt {

SystemClockState readSystemClock() noexcept {
  timex clock = {};
  const int state = ::adjtimex(&clock);
  if (state < 0) return {};
  return {true, state != TIME_ERROR && (clock.status & STA_UNSYNC) == 0, (clock.status & STA_PPSSIGNAL) != 0,
          static_cast<double>(clock.maxerror) / 1e6};
}

}  // namespace fathom::rt
