#include "realtime/kernel/health/trace_json.hpp"

#include <algorithm>
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

}  // namespace fathom::rt
