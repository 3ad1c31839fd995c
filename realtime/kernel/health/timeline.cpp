#include "realtime/kernel/health/timeline.hpp"

#include <algorithm>
#include <bit>

namespace fathom::rt {

TimelineTrack::TimelineTrack(std::size_t capacity)
    : mask_(std::bit_ceil(std::max<std::size_t>(capacity, 2)) - 1),
      slots_(std::make_unique<Slot[]>(mask_ + 1)) {}

void TimelineTrack::add(std::uint16_t stage, std::int64_t begin_ns, std::int64_t end_ns) noexcept {
  const std::uint64_t number = added_.load(std::memory_order_relaxed);
  Slot& slot = slots_[number & mask_];
  // A reader that sees any part of the new event also sees that its writing began, and leaves the slot out.
  started_.store(number + 1, std::memory_order_relaxed);
  slot.stage.store(stage, std::memory_order_release);
  slot.begin_ns.store(begin_ns, std::memory_order_release);
  slot.end_ns.store(end_ns, std::memory_order_release);
  added_.store(number + 1, std::memory_order_release);
}

std::vector<TimelineEvent> TimelineTrack::copy(std::int64_t from_ns, std::int64_t to_ns) const {
  const std::uint64_t end = added_.load(std::memory_order_acquire);
  const std::uint64_t size = capacity();
  const std::uint64_t begin = end > size ? end - size : 0;
  std::vector<TimelineEvent> all;
  all.reserve(static_cast<std::size_t>(end - begin));
  for (std::uint64_t number = begin; number < end; ++number) {
    const Slot& slot = slots_[number & mask_];
    all.push_back({static_cast<std::uint16_t>(slot.stage.load(std::memory_order_acquire)),
                   slot.begin_ns.load(std::memory_order_acquire),
                   slot.end_ns.load(std::memory_order_acquire)});
  }
  // Whatever was being written over while it was copied is left out.
  const std::uint64_t started = started_.load(std::memory_order_relaxed);
  const std::uint64_t whole = started > size ? started - size : 0;
  if (whole > begin)
    all.erase(all.begin(),
              all.begin() + static_cast<std::ptrdiff_t>(std::min<std::uint64_t>(whole - begin, all.size())));
  std::erase_if(all, [&](const TimelineEvent& e) { return e.end_ns < from_ns || e.begin_ns >= to_ns; });
  return all;
}

}  // namespace fathom::rt
