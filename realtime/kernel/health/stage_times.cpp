#include "realtime/kernel/health/stage_times.hpp"

#include <algorithm>
#include <bit>
#include <cassert>
#include <nlohmann/json.hpp>

namespace fathom::rt {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kProcess = 1;
constexpr int kTracksOfAThread = 100;

double microseconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-3;
}

Json named(const char* what, const std::string& name, int track) {
  return {{"name", what}, {"ph", "M"}, {"pid", kProcess}, {"tid", track}, {"args", {{"name", name}}}};
}

// Track of each event: the first track where it is beside or inside the other events. Events are ordered by
// their beginnings, longer ones first.
std::vector<int> tracksOf(const std::vector<TimelineEvent>& events) {
  std::vector<std::vector<std::int64_t>> open;  // of each track: ends of the stages around
  std::vector<int> tracks;
  for (const TimelineEvent& event : events) {
    std::size_t track = 0;
    for (; track < open.size(); ++track) {
      std::vector<std::int64_t>& around = open[track];
      while (!around.empty() && around.back() <= event.begin_ns) around.pop_back();
      if (around.empty() || event.end_ns <= around.back()) break;
    }
    if (track == open.size()) open.emplace_back();
    open[track].push_back(event.end_ns);
    tracks.push_back(static_cast<int>(track));
  }
  return tracks;
}

void addDeadlines(const TraceThread& thread, int track, std::int64_t from_ns, std::int64_t to_ns, Json& all) {
  const std::int64_t phase =
      ((thread.deadline_ns - from_ns) % thread.period_ns + thread.period_ns) % thread.period_ns;
  for (std::int64_t at = from_ns + phase; at < to_ns; at += thread.period_ns) {
    const bool missed = std::any_of(thread.events.begin(), thread.events.end(), [at](const TimelineEvent& e) {
      return e.begin_ns < at && e.end_ns > at;
    });
    all.push_back({{"name", missed ? "missed deadline" : "deadline"},
                   {"ph", "i"},
                   {"s", "t"},
                   {"ts", microseconds(at - from_ns)},
                   {"pid", kProcess},
                   {"tid", track}});
  }
}

}  // namespace

std::string traceJson(const std::string& title, std::span<const TraceThread> threads, std::int64_t from_ns,
                      std::int64_t to_ns) {
  Json all = Json::array({named("process_name", title, 0)});
  int first_track = 0;
  for (const TraceThread& thread : threads) {
    first_track += kTracksOfAThread;
    std::vector<TimelineEvent> events = thread.events;
    std::sort(events.begin(), events.end(), [](const TimelineEvent& a, const TimelineEvent& b) {
      return a.begin_ns != b.begin_ns ? a.begin_ns < b.begin_ns : a.end_ns > b.end_ns;
    });
    const std::vector<int> tracks = tracksOf(events);
    const int last = tracks.empty() ? 0 : *std::max_element(tracks.begin(), tracks.end());
    for (int track = 0; track <= last; ++track)
      all.push_back(named("thread_name", thread.name, first_track + track));
    for (std::size_t i = 0; i < events.size(); ++i) {
      const TimelineEvent& event = events[i];
      all.push_back({{"name", event.stage < thread.stages.size() ? thread.stages[event.stage]
                                                                 : "stage " + std::to_string(event.stage)},
                     {"ph", "X"},
                     {"ts", microseconds(event.begin_ns - from_ns)},
                     {"dur", microseconds(event.end_ns - event.begin_ns)},
                     {"pid", kProcess},
                     {"tid", first_track + tracks[i]}});
    }
    if (thread.period_ns > 0) addDeadlines(thread, first_track, from_ns, to_ns, all);
  }
  return Json{{"displayTimeUnit", "ms"}, {"traceEvents", all}}.dump() + "\n";
}

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
