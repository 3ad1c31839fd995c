#include "realtime/onboard/live/devices/input_sequencer.hpp"

#include <algorithm>
#include <cassert>

namespace fathom::onboard {

void InputSequencer::add(InputRing& ring) noexcept {
  assert(count_ < kMaxRings);
  heads_[count_++].ring = &ring;
}

bool InputSequencer::next(io::OnboardInput& input) noexcept {
  Head* first = nullptr;
  for (std::size_t i = 0; i < count_; ++i) {
    Head& head = heads_[i];
    if (!head.filled) head.filled = head.ring->pop(head.input);
    if (head.filled && (first == nullptr || head.input.arrival_utc_ns < first->input.arrival_utc_ns))
      first = &head;
  }
  if (first == nullptr) return false;
  input = first->input;
  first->filled = false;
  last_ns_ = input.arrival_utc_ns = std::max(input.arrival_utc_ns, last_ns_);
  return true;
}

io::OnboardInput InputSequencer::own(std::int64_t now_ns, const io::OnboardInput::What& what) noexcept {
  last_ns_ = std::max(now_ns, last_ns_);
  return {last_ns_, what};
}

}  // namespace fathom::onboard
