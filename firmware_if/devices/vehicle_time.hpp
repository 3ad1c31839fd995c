#pragma once

#include <cstdint>
#include <functional>

#include "realtime/kernel/vehicle_clock.hpp"

namespace fathom::io {

// The vehicle's time, UTC [ns]: a monotonic clock and an offset fixed when the program was armed, so that a
// step of the system's clock moves no sample. Must not throw and must be callable from any thread.
using VehicleTime = std::function<std::int64_t()>;
// That time against the system's UTC (rt::clockState), for stamps that others make by theirs. None: no
// difference.
using VehicleClockState = std::function<rt::ClockState()>;

}  // namespace fathom::io
