#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

namespace fathom::rt {

// What is left out of a frame's work, from nothing to everything. Each level includes the ones before it.
enum class DegradationLevel : std::uint8_t {
  kFull = 0,
  kFewerFeatures = 1,
  kNoClosures = 2,     // postponed, not lost: candidates stay in their queue
  kCoarserFusion = 3,  // and no meshes fused again
  kDropFrames = 4,     // frames are dropped while more than one waits; the others as at level 3
};
inline constexpr std::size_t kDegradationLevels = 5;

struct OverloadConfig {
  double raise_at = 0.9;  // frame time over period from which a frame counts as too slow
  double lower_at = 0.5;  // below which it counts as easy; no higher than raise_at
  int raise_after = 2;    // slow frames, or frames with too many waiting, in a row: one level up
  int lower_after = 10;   // easy frames in a row: one level down
  int waiting_limit = 2;  // pairs waiting behind this one from which it counts as too slow whatever it took
  int drop_waiting = 4;   // pairs waiting from which the level is kDropFrames at once
  int max_lower_after = 160;  // lower_after doubles up to this when a lowered level did not last
};

// Decides from measured times how much work a stereo pair may cost. A pure state machine: the same
// observations give the same decisions. The decisions are logged with their pairs, so that a replay needs no
// measured times.
//
// One level up after `raise_after` slow frames in a row; one level down after `lower_after` easy ones. A
// level that is raised again within `lower_after` frames after it was lowered doubles `lower_after` for the
// next attempt; an attempt that lasts resets it. A steady overload therefore costs ever fewer slow frames,
// and a passing one ends by itself.
class OverloadRule {
 public:
  struct Observation {
    std::int64_t period_ns = 0;      // between pairs
    std::int64_t last_frame_ns = 0;  // that the last mapped frame took; 0: none yet
    int waiting = 0;                 // pairs in the queue behind this one
    std::int64_t age_ns = 0;         // of this pair since it could have been mapped, not since its exposure
  };
  struct Decided {
    DegradationLevel level = DegradationLevel::kFull;
    bool drop = false;
  };
  struct Statistics {
    std::array<std::uint64_t, kDegradationLevels> pairs{};  // decided at each level, dropped ones included
    std::uint64_t raised = 0, lowered = 0, dropped = 0;
  };

  explicit OverloadRule(const OverloadConfig& config = {}) noexcept;

  // Once for each pair, before its work, in their order.
  [[nodiscard]] Decided decide(const Observation& observation) noexcept;

  // From any thread.
  [[nodiscard]] DegradationLevel level() const noexcept { return level_.load(std::memory_order_relaxed); }
  [[nodiscard]] const Statistics& statistics() const noexcept { return statistics_; }

 private:
  void raiseTo(DegradationLevel level) noexcept;
  void lower() noexcept;

  OverloadConfig config_;
  std::atomic<DegradationLevel> level_{DegradationLevel::kFull};
  int slow_in_a_row_ = 0, easy_in_a_row_ = 0;
  int lower_after_;
  int since_lowered_ = 0;  // frames; counts while a lowering is on trial
  bool lowering_on_trial_ = false;
  Statistics statistics_;
};

}  // namespace fathom::rt
