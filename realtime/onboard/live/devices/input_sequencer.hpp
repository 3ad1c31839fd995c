#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"

namespace fathom::onboard {

// From a device's thread to the hard tier. At 100 Hz of draining and at most some hundred samples a second,
// never more than a few wait; full only when the hard tier stands still for a second.
using InputRing = rt::SpscRing<io::OnboardInput, 256>;

// Merges the inputs of many devices into one sequence: the earliest arrival first among those that wait,
// never earlier than what was given out before. Part of the hard tier; allocates nothing.
class InputSequencer {
 public:
  static constexpr std::size_t kMaxRings = 12;

  // Before it runs. The ring must outlive the sequencer; more than kMaxRings is a broken contract.
  void add(InputRing& ring) noexcept;
  // No input is older than this: the last one before the program started again.
  void startAfter(std::int64_t utc_ns) noexcept { last_ns_ = utc_ns; }

  // The next input in order; false when nothing waits.
  [[nodiscard]] bool next(io::OnboardInput& input) noexcept;
  // An input of the sequencer's own thread, put behind what was given out.
  [[nodiscard]] io::OnboardInput own(std::int64_t now_ns, const io::OnboardInput::What& what) noexcept;

 private:
  struct Head {
    InputRing* ring = nullptr;
    bool filled = false;
    io::OnboardInput input;
  };
  std::array<Head, kMaxRings> heads_;
  std::size_t count_ = 0;
  std::int64_t last_ns_ = INT64_MIN;
};

}  // namespace fathom::onboard
