#pragma once

#include <pthread.h>
#include <sched.h>

namespace fathom::sim {

// Lets the calling thread, which plays a device, run before all of the program under test but its hard tier:
// on a vehicle devices do not wait for its computer. Their work is some tens of microseconds at a time.
// Without the privilege it stays as it is, and the bench's lateness, which is reported, grows.
inline void takeDevicePriority() {
  constexpr int kPriority = 75;  // above fathom-onboard's device threads (70), below its hard tier (80)
  const sched_param param = {kPriority};
  (void)::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &param);
}

}  // namespace fathom::sim
