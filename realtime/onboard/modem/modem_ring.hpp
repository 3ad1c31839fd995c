#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "realtime/kernel/frame_port.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"

namespace fathom::onboard {

// A modem frame to be sent. A received one is split into its link frames where it is received
// (io::ModemFrame), so that the many places that hold an input stay small.
struct OutgoingFrame {
  std::uint16_t size = 0;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> bytes{};
  [[nodiscard]] std::span<const std::uint8_t> data() const { return {bytes.data(), size}; }
};

// From the mapper to the modem's thread.
using ModemRing = rt::SpscRing<OutgoingFrame, 64>;

}  // namespace fathom::onboard
