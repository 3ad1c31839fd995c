#pragma once

#include <cstddef>
#include <cstdint>

#include "firmware_if/camera/camera_source.hpp"
#include "firmware_if/log/onboard_input.hpp"
#include "realtime/kernel/spsc_ring.hpp"

namespace fathom::onboard {

// From a device's thread to the hard tier. At 100 Hz of draining and at most some hundred samples a second,
// never more than a few wait; full only when the hard tier stands still for a second.
using InputRing = rt::SpscRing<io::OnboardInput, 256>;

}  // namespace fathom::onboard
