#pragma once

#include <cstdint>
#include <functional>

namespace fathom::io {

// The vehicle's time, UTC [ns]: a monotonic clock and an offset fixed when the program was armed, so that a
// step of the system's clock moves no sample. Must not throw and must be callable from any thread.
using VehicleTime = std::function<std::int64_t()>;

}  // namespace fathom::io
