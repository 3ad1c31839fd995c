// How a live run ends: every wait has a deadline.
#include "realtime/onboard/live/live_system.hpp"

#include <dirent.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "realtime/base/units.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/onboard/mapper/mapper_tier.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kDevicesEndNs = 150'000'000;      // devices' threads leave within this
constexpr std::int64_t kLongestJoinNs = 10'000'000'000;  // of a program that is given up

using rt::milliseconds;

void addStageJson(nlohmann::ordered_json& all, const rt::StageSummary& s, std::int64_t p999_ns) {
  if (s.count == 0) return;
  all[s.name] = {{"count", s.count},
                 {"p50_ms", milliseconds(s.p50_ns)},
                 {"p99_ms", milliseconds(s.p99_ns)},
                 {"p99_9_ms", milliseconds(p999_ns)},
                 {"max_ms", milliseconds(s.max_ns)},
                 {"deadline_misses", s.misses}};
}

nlohmann::ordered_json stagesOf(const rt::StageTimes& times) {
  nlohmann::ordered_json all;
  for (std::size_t i = 0; i < times.stages(); ++i)
    addStageJson(all, times.summary(i), times.histogram(i).percentile(99.9));
  return all;
}

nlohmann::ordered_json stagesOf(const MapperFigures& figures) {
  nlohmann::ordered_json all;
  for (std::size_t i = 0; i < MapperTier::kStages; ++i)
    addStageJson(all, MapperTier::summaryOf(figures, i), figures.stages[i].p999_ns);
  return all;
}

nlohmann::ordered_json memoryOf(const rt::MemoryBudget& budget) {
  nlohmann::ordered_json memory;
  memory["budget_mib"] = mebibytes(budget.budgetBytes());
  memory["planned_mib"] = mebibytes(budget.plannedBytes());
  rt::ProcessMemory process;
  rt::ProcessFigures now;
  if (process.read(now)) {
    memory["resident_mib"] = mebibytes(now.resident);
    memory["highest_resident_mib"] = mebibytes(now.highest_resident);
    memory["locked_mib"] = mebibytes(now.locked);
  }
  for (std::size_t i = 0; i < budget.pools(); ++i) {
    const rt::MemoryBudget::Row row = budget.read(i);
    nlohmann::ordered_json pool = {{"planned_mib", mebibytes(row.planned)}};
    if (row.measured) {
      pool["high_water_mib"] = mebibytes(row.use.high_water);
      pool["refused"] = row.use.refused;
    }
    memory["pools"][row.name] = pool;
  }
  return memory;
}

// What the mapper process added to its timeline, as far as it is still there.
std::vector<rt::TimelineEvent> visionEvents(const MapperUp& up, std::int64_t from_ns, std::int64_t to_ns) {
  std::vector<rt::TimelineEvent> events;
  const std::uint64_t next = up.timeline.next();
  const std::uint64_t kept = up.timeline.capacity();
  for (std::uint64_t p = next > kept ? next - kept : 0; p < next; ++p) {
    rt::TimelineEvent event;
    if (up.timeline.read(p, event) != decltype(up.timeline)::Read::kGot) continue;
    if (event.stage < MapperTier::kStages && event.end_ns >= from_ns && event.begin_ns < to_ns)
      events.push_back(event);
  }
  return events;
}

nlohmann::ordered_json loopOf(const rt::PeriodicLoop::Statistics& loop) {
  return {{"cycles", loop.cycles},
          {"slipped", loop.skipped_cycles},
          {"wake_up_p50_us", static_cast<double>(loop.jitter_ns.percentile(50)) * 1e-3},
          {"wake_up_p99_9_us", static_cast<double>(loop.jitter_ns.percentile(99.9)) * 1e-3},
          {"wake_up_max_us", static_cast<double>(loop.jitter_ns.max()) * 1e-3},
          {"body_p50_us", static_cast<double>(loop.body_ns.percentile(50)) * 1e-3},
          {"body_max_us", static_cast<double>(loop.max_body_ns) * 1e-3}};
}

nlohmann::ordered_json partsOf(const PartStates& parts) {
  nlohmann::ordered_json all;
  for (const PartReport& part : parts.read()) {
    all[part.name]["state"] = nameOf(part.state);
    if (!part.reason.empty()) all[part.name]["reason"] = part.reason;
  }
  return all;
}

nlohmann::ordered_json recorderOf(const io::Recorder& recorder) {
  const io::Recorder::Counters c = recorder.counters();
  return {{"inputs", c.inputs},
          {"images", c.images},
          {"raw_entries", c.raw_entries},
          {"bytes", c.bytes},
          {"syncs", c.syncs},
          {"inputs_dropped", c.inputs_dropped},
          {"raw_dropped", c.raw_dropped},
          {"images_dropped_queue", c.images_dropped_queue},
          {"images_dropped_disk", c.images_dropped_disk},
          {"write_failures", c.write_failures},
          {"worst_sync_ms", milliseconds(c.worst_sync_ns)},
          {"worst_unsafe_ms", milliseconds(c.worst_unsafe_ns)},
          {"input_high_water", c.input_high_water},
          {"image_high_water", c.image_high_water}};
}

nlohmann::ordered_json deviceOf(const io::DeviceHealth& d) {
  nlohmann::ordered_json device = {{"open", d.open}, {"samples", d.samples}, {"disconnects", d.disconnects}};
  for (const auto& [name, value] : d.counters) device[std::string(name)] = value;
  return device;
}

}  // namespace

bool LiveSystem::waitFor(const std::function<bool()>& done, std::int64_t until_ns) {
  while (!done()) {
    if (clock_.monotonicNs() >= until_ns) return false;
    rt::restFor(rt::kPollRest_ns);
  }
  return true;
}

void LiveSystem::finishThreads(End& end, std::int64_t until_ns, bool dive_ends) {
  stop_hard_ = stop_modem_ = stop_recorder_ = true;
  const std::vector<std::string> still = threads_.join([&] { return clock_.monotonicNs() < until_ns; });
  for (const std::string& name : still) end.left_out.push_back(name + " hangs and is left behind");
  hangs_ = !still.empty();
  stopped_ = true;
  // One that hangs in the middle of it has the recorder.
  if (std::find(still.begin(), still.end(), "recorder") != still.end()) {
    end.left_out.emplace_back("the recording is not closed");
    return;
  }
  takeFromMapper();
  const io::Recorder::CloseResult closed = recorder_.close(rt::seconds(until_ns - clock_.monotonicNs()));
  if (!closed.text.empty() && (dive_ends || !closed.log_whole)) end.left_out.push_back(closed.text);
}

LiveSystem::End LiveSystem::end(double most_s) {
  End end;
  if (stopped_) return end;
  // The last part of the time is for what follows a map that does not come.
  constexpr double kForTheRest = 0.9;
  const std::int64_t begin = clock_.monotonicNs();
  const std::int64_t until = begin + rt::nanoseconds(most_s),
                     map_until = begin + rt::nanoseconds(most_s * kForTheRest);
  ends_ = true;
  measured_.cpu = cpuTimes();
  measured_.heap_used = heap_.usedOfReserve();
  measured_.heap_overflow = heap_.overflowBytes();
  threads_.unwatch();
  stop_devices_ = true;
  // What the devices gave so far comes before the end.
  rt::restFor(kDevicesEndNs);
  const bool marked = waitFor(
                          [&] {
                            return hard_.mark({io::Mark::Kind::kEnd, 0});
                          },
                          map_until) &&
                      waitFor([&] { return hard_.ended(); }, map_until);
  if (!marked) end.left_out.emplace_back("navigation hangs: the log has no end");
  std::vector<std::string> events;
  const auto mapped = [&] {
    supervisor_->stepMapper(events);
    return supervisor_->mapperDone();
  };
  if (!waitFor(mapped, map_until)) {
    end.left_out.emplace_back("the map was not finished in time; make it from the recording");
    child_->kill();
  }
  for (const std::string& event : events) end.left_out.push_back(event);
  end.mapped = supervisor_->phase() == MapperPhase::kEnded;
  end.no_map = supervisor_->phase() == MapperPhase::kNoMap;
  finishThreads(end, until, true);
  return end;
}

LiveSystem::End LiveSystem::leave(double most_s) {
  End end;
  if (stopped_) return end;
  const std::int64_t until = clock_.monotonicNs() + rt::nanoseconds(most_s);
  ends_ = true;
  measured_.cpu = cpuTimes();
  threads_.unwatch();
  supervisor_->stopRestarts();
  // So that the next start has little to catch up with; if it comes to nothing, there is an older one.
  constexpr double kForTheState = 0.3;
  MapperFigures before, now;
  (void)channel_.up().figures.read(before);
  supervisor_->askForCheckpoint();
  (void)supervisor_->step(hard_skipped_.load(std::memory_order_relaxed));
  const auto saved = [&] {
    return !child_->running() ||
           (channel_.up().figures.read(now) && now.checkpoints.written > before.checkpoints.written);
  };
  (void)waitFor(saved, clock_.monotonicNs() + rt::nanoseconds(most_s * kForTheState));
  child_->kill();
  stop_devices_ = true;
  finishThreads(end, until, false);
  return end;
}

LiveSystem::~LiveSystem() {
  if (stopped_) return;
  ends_ = stop_devices_ = stop_hard_ = stop_modem_ = stop_recorder_ = true;
  go_ = true;
  const std::int64_t until = clock_.monotonicNs() + kLongestJoinNs;
  if (threads_.join([&] { return clock_.monotonicNs() < until; }).empty()) return;
  // What hangs would be waited for for ever, and what it uses is about to go.
  std::_Exit(EXIT_FAILURE);
}

std::vector<ThreadFigures> cpuTimes() {
  std::vector<ThreadFigures> all;
  const double tick = static_cast<double>(::sysconf(_SC_CLK_TCK));
  DIR* tasks = ::opendir("/proc/self/task");
  if (tasks == nullptr) return all;
  while (const dirent* entry = ::readdir(tasks)) {
    const std::string id = entry->d_name;
    if (id[0] == '.') continue;
    std::ifstream in("/proc/self/task/" + id + "/stat");
    std::string line;
    std::getline(in, line);
    const std::size_t open = line.find('('), close = line.rfind(')');
    if (open == std::string::npos || close == std::string::npos) continue;
    std::istringstream rest(line.substr(close + 1));
    std::string skipped;
    for (int i = 0; i < 11; ++i) rest >> skipped;  // state to cmajflt: utime and stime follow
    double user = 0, system = 0;
    rest >> user >> system;
    all.push_back({line.substr(open + 1, close - open - 1), (user + system) / tick});
  }
  ::closedir(tasks);
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.cpu_s > b.cpu_s; });
  return all;
}

std::string timelineOf(const LiveSystem& live, std::int64_t now_ns, double seconds) {
  const std::int64_t from_ns = now_ns - rt::nanoseconds(seconds);
  const rt::RealtimeConfig& realtime = live.config().live.realtime;
  const auto named = [&](const char* name, rt::Tier tier) {
    const rt::ThreadConfig c = rt::threadConfig(realtime, tier, "");
    rt::TraceThread shown;
    shown.name = std::string(name) + (c.fifo_priority > 0 && !realtime.soft
                                          ? " (SCHED_FIFO " + std::to_string(c.fifo_priority) + ")"
                                          : " (best effort)");
    return shown;
  };
  const auto thread = [&](const char* name, rt::Tier tier, const rt::StageTimes& stages) {
    rt::TraceThread shown = named(name, tier);
    for (std::size_t i = 0; i < stages.stages(); ++i) shown.stages.emplace_back(stages.name(i));
    shown.events = stages.track()->copy(from_ns, now_ns);
    return shown;
  };
  rt::TraceThread vision = named("vision", rt::Tier::kSoft);
  for (const rt::StageSpec& stage : MapperTier::stageSpecs()) vision.stages.emplace_back(stage.name);
  vision.events = visionEvents(live.mapper().up(), from_ns, now_ns);
  std::array<rt::TraceThread, 3> threads = {thread("navigation", rt::Tier::kHard, live.hardStages()), vision,
                                            thread("recorder", rt::Tier::kBestEffort, live.recorderStages())};
  threads[0].deadline_ns = live.firstDeadlineNs();
  if (threads[0].deadline_ns != 0) threads[0].period_ns = realtime.period_ns;
  return rt::traceJson("fathom-onboard", threads, from_ns, now_ns);
}

std::string liveJson(const LiveSystem& live_system, double wall_s, const StartTimes& start) {
  nlohmann::ordered_json live;
  live["wall_s"] = wall_s;
  live["start"] = {
      {"armed_s", start.armed}, {"navigating_s", start.navigating}, {"first_pair_s", start.first_pair}};
  live["soft"] = live_system.config().live.realtime.soft;
  live["missing"] = live_system.arming().missingNames();
  live["parts"] = partsOf(live_system.parts());
  MapperFigures mapper;
  (void)live_system.mapper().up().figures.read(mapper);
  MapState map;
  (void)live_system.mapper().up().readMap(map);
  if (const rt::PeriodicLoop::Statistics* hard = live_system.hardLoop()) live["hard_loop"] = loopOf(*hard);
  const rt::ThreadCost cost = live_system.hardCost();
  live["hard_tier_after_arming"] = {{"heap_calls", cost.heap_calls},
                                    {"minor_faults", cost.minor_faults},
                                    {"major_faults", cost.major_faults}};
  live["stages"]["navigation"] = stagesOf(live_system.hardStages());
  live["stages"]["vision"] = stagesOf(mapper);
  live["stages"]["recorder"] = stagesOf(live_system.recorderStages());
  const rt::OverloadRule::Statistics& overload = mapper.overload;
  live["degradation"] = {{"pairs_at_level", overload.pairs},
                         {"raised", overload.raised},
                         {"lowered", overload.lowered},
                         {"dropped", overload.dropped}};
  live["frames_given_back_unused"] = map.frames_given_back;
  live["frames_not_lent"] = live_system.framesNotLent();
  live["inputs_skipped"] = map.inputs_skipped;
  live["mapper_starts"] = live_system.supervisor().mapperStarts();
  live["clock_steps"] = live_system.supervisor().clockSteps();
  live["resumed"] = live_system.resumed();
  live["away_s"] = live_system.awaySeconds();
  const CheckpointWriter::Counters& saved = mapper.checkpoints;
  live["checkpoints"] = {{"written", saved.written},
                         {"failed", saved.failed},
                         {"late", saved.late},
                         {"too_large", saved.too_large},
                         {"bytes", saved.bytes}};
  live["recorder"] = recorderOf(live_system.recorder());
  for (const io::DeviceHealth& device : live_system.deviceHealth())
    live["devices"][std::string(device.name)] = deviceOf(device);
  if (live_system.modem() != nullptr) {
    const ModemThread::Counters& m = live_system.modem()->counters();
    live["devices"]["modem"] = {{"sent", m.sent.load()},
                                {"of_the_vehicle_itself", m.own.load()},
                                {"refused", m.refused.load()},
                                {"received", m.received.load()},
                                {"dropped", m.dropped.load()}};
  }
  for (const ThreadFigures& thread : live_system.measured().cpu) live["cpu_s"][thread.name] = thread.cpu_s;
  live["memory"] = memoryOf(live_system.budget());
  live["memory"]["resident_at_arming_mib"] = mebibytes(live_system.measured().resident_at_arming);
  live["memory"]["mapper"] = {{"planned_mib", mebibytes(mapper.planned)},
                              {"resident_mib", mebibytes(mapper.resident)},
                              {"resident_at_arming_mib", mebibytes(mapper.resident_at_arming)},
                              {"heap_beyond_reserve_mib", mebibytes(mapper.heap_overflow)},
                              {"minor_faults_after_arming", mapper.minor_faults}};
  live["memory"]["heap_in_use_of_reserve_mib"] = mebibytes(live_system.measured().heap_used);
  live["memory"]["heap_beyond_reserve_mib"] = mebibytes(live_system.measured().heap_overflow);
  for (std::size_t i = 0; i < live_system.watchdog().tiers(); ++i) {
    const rt::Watchdog::TierState& tier = live_system.watchdog().state(i);
    live["watchdog"][tier.spec.name] = {{"times_stuck", tier.times_stuck},
                                        {"restarts", tier.restarts},
                                        {"longest_silent_ms", milliseconds(tier.longest_silent_ns)}};
  }
  return live.dump(2) + "\n";
}

}  // namespace fathom::onboard
