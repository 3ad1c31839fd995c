#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "realtime/base/numbers/log_histogram.hpp"
#include "realtime/kernel/rings/broadcast_ring.hpp"

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

struct StageSpec {
  const char* name = "";         // text that outlives the stages: a literal
  std::int64_t deadline_ns = 0;  // longer counts as a miss; 0: none
};

struct StageSummary {
  const char* name = "";
  std::uint64_t count = 0, misses = 0;
  std::int64_t last_ns = 0, p50_ns = 0, p99_ns = 0, max_ns = 0;
};

inline constexpr std::size_t kMaxStages = 24;

struct StageSnapshot {
  std::size_t stages = 0;
  std::array<StageSummary, kMaxStages> of{};
  [[nodiscard]] std::span<const StageSummary> all() const { return {of.data(), stages}; }
};

// How long each of a tier's stages takes. One thread writes; one other reads what was published last. All
// memory is taken at construction.
class StageTimes {
 public:
  using Snapshot = StageSnapshot;

  // At most kMaxStages; more is a broken contract. With a track, every stage is also drawn there.
  explicit StageTimes(std::span<const StageSpec> stages, TimelineTrack* track = nullptr);

  // By the writer: stage number `stage` (the place in the list) ran from begin to end, monotonic.
  void add(std::size_t stage, std::int64_t begin_ns, std::int64_t end_ns) noexcept;
  // By the writer, some times a second at most (some 2 us a stage): what a reader gets from now on.
  void publish() noexcept;

  // By the reader; false when nothing was published yet.
  [[nodiscard]] bool read(Snapshot& snapshot) noexcept { return published_.read(snapshot); }

  [[nodiscard]] std::size_t stages() const noexcept { return stages_.size(); }
  [[nodiscard]] const TimelineTrack* track() const noexcept { return track_; }
  [[nodiscard]] const char* name(std::size_t stage) const { return stages_.at(stage).spec.name; }
  // By the writer, or when it rests.
  [[nodiscard]] StageSummary summary(std::size_t stage) const noexcept;
  [[nodiscard]] const LogHistogram& histogram(std::size_t stage) const { return stages_.at(stage).times; }

 private:
  struct Stage {
    StageSpec spec;
    LogHistogram times;  // [ns]
    std::int64_t last_ns = 0;
    std::uint64_t misses = 0;
  };
  std::vector<Stage> stages_;
  TimelineTrack* track_;
  LatestValue<Snapshot> published_;
};

// One thread of a trace.
struct TraceThread {
  std::string name;                   // "navigation (SCHED_FIFO 80)"
  std::vector<std::string> stages;    // names, by stage number
  std::vector<TimelineEvent> events;  // of the time shown
  std::int64_t period_ns = 0;         // of a periodic thread's deadlines; 0: none
  std::int64_t deadline_ns = 0;       // any one of them (PeriodicLoop::nextDeadlineNs())
};

// Chrome's trace event format, which Perfetto (ui.perfetto.dev) opens. Times are monotonic, from < to; the
// trace counts from `from_ns`. Stages that overlap without nesting get separate tracks. The deadlines of a
// periodic thread are marked; those that a stage overran are marked as missed.
[[nodiscard]] std::string traceJson(const std::string& title, std::span<const TraceThread> threads,
                                    std::int64_t from_ns, std::int64_t to_ns);

}  // namespace fathom::rt
