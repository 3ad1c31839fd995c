#include "realtime/kernel/health/stage_times.hpp"

#include <cassert>

namespace fathom::rt {

StageTimes::StageTimes(std::span<const StageSpec> stages, TimelineTrack* track)
    : stages_(stages.size()), track_(track) {
  assert(stages.size() <= kMaxStages);
  for (std::size_t i = 0; i < stages.size(); ++i) stages_[i].spec = stages[i];
}

void StageTimes::add(std::size_t stage, std::int64_t begin_ns, std::int64_t end_ns) noexcept {
  assert(stage < stages_.size());
  Stage& s = stages_[stage];
  s.last_ns = end_ns - begin_ns;
  s.times.add(s.last_ns);
  if (s.spec.deadline_ns > 0 && s.last_ns > s.spec.deadline_ns) ++s.misses;
  if (track_ != nullptr) track_->add(static_cast<std::uint16_t>(stage), begin_ns, end_ns);
}

StageSummary StageTimes::summary(std::size_t stage) const noexcept {
  constexpr double kMedian = 50, kWorstPercent = 99;
  assert(stage < stages_.size());
  const Stage& s = stages_[stage];
  return {s.spec.name,
          s.times.count(),
          s.misses,
          s.last_ns,
          s.times.percentile(kMedian),
          s.times.percentile(kWorstPercent),
          s.times.max()};
}

void StageTimes::publish() noexcept {
  Snapshot snapshot;
  snapshot.stages = stages_.size();
  for (std::size_t i = 0; i < stages_.size(); ++i) snapshot.of[i] = summary(i);
  published_.write(snapshot);
}

}  // namespace fathom::rt
