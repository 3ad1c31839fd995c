#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "realtime/kernel/health/timeline.hpp"
#include "realtime/kernel/latest_value.hpp"
#include "realtime/kernel/log_histogram.hpp"

namespace fathom::rt {

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

}  // namespace fathom::rt
