#pragma once

namespace fathom::rt {

// What the kernel says of the system's clock (adjtimex, man 2 adjtimex).
struct SystemClockState {
  bool known = false;         // false: the system does not tell
  bool synchronised = false;  // somebody (chrony, ntpd, ptp4l) disciplines it
  bool pps = false;           // by a pulse a second
  double error_s = 0;         // largest, as whoever disciplines it states [s]
};
[[nodiscard]] SystemClockState readSystemClock() noexcept;

}  // namespace fathom::rt
