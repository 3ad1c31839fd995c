#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace fathom::rt {

struct TimelineEvent {
  std::uint16_t stage = 0;
  std::int64_t begin_ns = 0, end_ns = 0;  // monotonic
};

// The last stages that one thread ran, in a ring of fixed size. The thread writes, wait-free; any thread may
// copy at any time and gets whole events only.
class TimelineTrack {
 public:
  // `capacity` is rounded up to a power of two. 24 bytes an event: at 100 Hz with three stages, 4096 events
  // are 14 s.
  explicit TimelineTrack(std::size_t capacity = 4096);
  TimelineTrack(const TimelineTrack&) = delete;
  TimelineTrack& operator=(const TimelineTrack&) = delete;

  void add(std::uint16_t stage, std::int64_t begin_ns, std::int64_t end_ns) noexcept;

  // Events that end at or after `from_ns` and begin before `to_ns`, in the order in which they were added.
  [[nodiscard]] std::vector<TimelineEvent> copy(std::int64_t from_ns, std::int64_t to_ns) const;
  [[nodiscard]] std::size_t capacity() const noexcept { return mask_ + 1; }

 private:
  struct Slot {
    std::atomic<std::uint64_t> stage{0};
    std::atomic<std::int64_t> begin_ns{0}, end_ns{0};
  };
  std::size_t mask_;
  std::unique_ptr<Slot[]> slots_;
  std::atomic<std::uint64_t> started_{0}, added_{0};  // events whose writing began, and ended
};

}  // namespace fathom::rt
