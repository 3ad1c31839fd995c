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
// From the hard tier to the soft one, which may be busy with a frame, or with catching up after a restart.
using SequenceRing = rt::SpscRing<io::OnboardInput, 8192>;
// From a camera's thread to the soft tier: the frames that the sequence's stamps speak of. As many as any
// pool has.
using FrameRing = rt::SpscRing<io::CameraFrame, 64>;
// Frames for the modem, from the soft tier to the modem's thread.
using ModemRing = rt::SpscRing<io::ModemFrame, 64>;

}  // namespace fathom::onboard
