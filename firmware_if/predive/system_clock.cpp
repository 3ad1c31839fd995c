#include "firmware_if/predive/system_clock.hpp"

#include <sys/timex.h>

namespace fathom::io {

SystemClockState readSystemClock() {
  timex clock = {};
  const int state = ::adjtimex(&clock);
  if (state < 0) return {};
  return {true, state != TIME_ERROR && (clock.status & STA_UNSYNC) == 0, (clock.status & STA_PPSSIGNAL) != 0,
          static_cast<double>(clock.maxerror) / 1e6};
}

}  // namespace fathom::io
