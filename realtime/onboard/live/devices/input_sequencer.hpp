#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "realtime/onboard/live/devices/input_rings.hpp"

namespace fathom::onboard {

// Brings what many devices give into one order: the earliest arrival first among what is there, and never
// earlier than what was given out before. In the hard tier; allocates nothing.
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
