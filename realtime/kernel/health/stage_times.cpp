#include "realtime/kernel/health/stage_times.hpp"

#include <algorithm>
#include <bit>
#include <cassert>

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
