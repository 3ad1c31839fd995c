#include <dirent.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "realtime/kernel/health/trace_json.hpp"
#include "realtime/kernel/memory/process_memory.hpp"
#include "realtime/kernel/seconds.hpp"
#include "realtime/onboard/live/live_system.hpp"

// What a live run tells about itself: memory planned, CPU by thread, live.json, a trace of its stages.
namespace fathom::onboard {
namespace {

constexpr double kMiB = 1024.0 * 1024.0;

double milliseconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-6;
}

nlohmann::ordered_json stagesOf(const rt::StageTimes& times) {
  nlohmann::ordered_json all;
  for (std::size_t i = 0; i < times.stages(); ++i) {
    const rt::StageSummary s = times.summary(i);
    if (s.count == 0) continue;
    all[s.name] = {{"count", s.count},
                   {"p50_ms", milliseconds(s.p50_ns)},
                   {"p99_ms", milliseconds(s.p99_ns)},
                   {"p99_9_ms", milliseconds(times.histogram(i).percentile(99.9))},
                   {"max_ms", milliseconds(s.max_ns)},
                   {"deadline_misses", s.misses}};
  }
  return all;
}

nlohmann::ordered_json memoryOf(const rt::MemoryBudget& budget) {
  nlohmann::ordered_json memory;
  memory["budget_mib"] = static_cast<double>(budget.budgetBytes()) / kMiB;
  memory["planned_mib"] = static_cast<double>(budget.plannedBytes()) / kMiB;
  rt::ProcessMemory process;
  rt::ProcessFigures now;
  if (process.read(now)) {
    memory["resident_mib"] = static_cast<double>(now.resident) / kMiB;
    memory["highest_resident_mib"] = static_cast<double>(now.highest_resident) / kMiB;
    memory["locked_mib"] = static_cast<double>(now.locked) / kMiB;
  }
  for (std::size_t i = 0; i < budget.pools(); ++i) {
    const rt::MemoryBudget::Row row = budget.read(i);
    nlohmann::ordered_json pool = {{"planned_mib", static_cast<double>(row.planned) / kMiB}};
    if (row.measured) {
      pool["high_water_mib"] = static_cast<double>(row.use.high_water) / kMiB;
      pool["refused"] = row.use.refused;
    }
    memory["pools"][row.name] = pool;
  }
  return memory;
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

void LiveSystem::planMemory() {
  const auto camera = [&](const char* name, io::CameraSource& source) {
    rt::SharedBlocks& pool = source.pool();
    budget_.add(name, pool.blocks() * pool.blockBytes(), [&pool] {
      return rt::PoolUse{pool.held() * pool.blockBytes(), pool.highWater() * pool.blockBytes(),
                         pool.refused()};
    });
  };
  camera("left camera's frames", *devices_.left);
  camera("right camera's frames", *devices_.right);
  const MapCore& map = run_->system().map();
  budget_.addFixed("map: quadtree and meshes' poses", map.movingMap().memoryBytes());
  if (const LocalisationCore* localisation = map.localisation()) {
    budget_.addFixed("pose graph", localisation->graph().memoryBytes());
    budget_.addFixed("keyframes and closures",
                     localisation->memoryBytes() - localisation->graph().memoryBytes());
  }
  budget_.addFixed("link", run_->system().link().memoryBytes());
  budget_.add("sequence of inputs", sizeof(sequence_), [this] {
    constexpr std::size_t kEach = sizeof(io::OnboardInput);
    return rt::PoolUse{sequence_.used() * kEach, sequence_.highWater() * kEach, sequence_.refused()};
  });
  budget_.addFixed("rings of devices", sizeof(own_rings_) + sizeof(frame_rings_) + sizeof(modem_ring_) +
                                           samples_.size() * sizeof(InputRing));
  budget_.addFixed("recorder",
                   setup_.config.live.recorder.raw_lanes * setup_.config.live.recorder.raw_queue_kib * 1024);
  budget_.add("saved state", checkpoints_->capacity(), [this] {
    const CheckpointWriter::Counters c = checkpoints_->counters();
    return rt::PoolUse{static_cast<std::size_t>(c.bytes), static_cast<std::size_t>(c.bytes), c.too_large};
  });
  std::size_t stacks = 0;
  for (const Worker& worker : workers_) stacks += worker.thread->stackBytes();
  budget_.addFixed("stacks", stacks);
  budget_.addFixed("heap of libraries and reports", setup_.config.live.memory.heap_bytes);
  // What is not above and lives as long as the program: images under way in stereo, lighting and features,
  // rows. Memory that is free again is part of the heap's reserve.
  const std::size_t heap_free = rt::HeapReserve::heapBytes() - rt::HeapReserve::usedBytes();
  const std::size_t planned = budget_.plannedBytes() - setup_.config.live.memory.heap_bytes + heap_free;
  const std::size_t mapped = rt::mappedPrivateBytes();
  if (mapped > planned) budget_.addFixed("images under way", mapped - planned);
  // Locked memory makes all of it resident.
  budget_.addFixed("program and libraries", rt::mappedFileBytes());
}

std::vector<LiveSystem::ThreadFigures> LiveSystem::cpuTimes() const {
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

std::string LiveSystem::timeline(double seconds) {
  const std::int64_t now = clock_.monotonicNs(), from = now - rt::nanoseconds(seconds);
  const rt::RealtimeConfig& realtime = setup_.config.live.realtime;
  const auto thread = [&](const char* name, rt::Tier tier, const rt::StageTimes& stages,
                          const rt::TimelineTrack& track) {
    const rt::ThreadConfig c = rt::threadConfig(realtime, tier, "");
    rt::TraceThread shown;
    shown.name = std::string(name) + (c.fifo_priority > 0 && !realtime.soft
                                          ? " (SCHED_FIFO " + std::to_string(c.fifo_priority) + ")"
                                          : " (best effort)");
    for (std::size_t i = 0; i < stages.stages(); ++i) shown.stages.emplace_back(stages.name(i));
    shown.events = track.copy(from, now);
    return shown;
  };
  std::array<rt::TraceThread, 3> threads = {
      thread("navigation", rt::Tier::kHard, hard_stages_, hard_track_),
      thread("vision", rt::Tier::kSoft, soft_stages_, soft_track_),
      thread("recorder", rt::Tier::kBestEffort, recorder_stages_, recorder_track_)};
  threads[0].deadline_ns = first_deadline_ns_.load(std::memory_order_relaxed);
  if (threads[0].deadline_ns != 0) threads[0].period_ns = realtime.period_ns;
  return rt::traceJson("fathom-onboard", threads, from, now);
}

bool LiveSystem::write() {
  const double wall_s = static_cast<double>(clock_.monotonicNs() - begun_mono_ns_) * 1e-9;
  if (!run_->write(0, wall_s)) return false;
  nlohmann::ordered_json live;
  live["wall_s"] = wall_s;
  live["soft"] = setup_.config.live.realtime.soft;
  live["missing"] = arming_.missingNames();
  const rt::PeriodicLoop::Statistics& loop = loop_->statistics();
  live["hard_loop"] = {{"cycles", loop.cycles},
                       {"slipped", loop.slipped_cycles},
                       {"wake_up_p50_us", static_cast<double>(loop.jitter_ns.percentile(50)) * 1e-3},
                       {"wake_up_p99_9_us", static_cast<double>(loop.jitter_ns.percentile(99.9)) * 1e-3},
                       {"wake_up_max_us", static_cast<double>(loop.jitter_ns.max()) * 1e-3},
                       {"body_p50_us", static_cast<double>(loop.body_ns.percentile(50)) * 1e-3},
                       {"body_max_us", static_cast<double>(loop.max_body_ns) * 1e-3}};
  const rt::ThreadCost cost = hardCost();
  live["hard_tier_after_arming"] = {{"heap_calls", cost.heap_calls},
                                    {"minor_faults", cost.minor_faults},
                                    {"major_faults", cost.major_faults}};
  live["stages"]["navigation"] = stagesOf(hard_stages_);
  live["stages"]["vision"] = stagesOf(soft_stages_);
  live["stages"]["recorder"] = stagesOf(recorder_stages_);
  const rt::OverloadRule::Statistics& overload = soft_->overload().statistics();
  live["degradation"] = {{"pairs_at_level", overload.pairs},
                         {"raised", overload.raised},
                         {"lowered", overload.lowered},
                         {"dropped", overload.dropped}};
  live["frames_given_back_unused"] = frames_.givenBackUnused();
  live["sequence_refused"] = sequence_.refused();
  live["clock_steps"] = clock_steps_;
  live["resumed"] = resumed_;
  live["away_s"] = awaySeconds();
  const CheckpointWriter::Counters saved = checkpoints_->counters();
  live["checkpoints"] = {{"written", saved.written},
                         {"failed", saved.failed},
                         {"late", saved.late},
                         {"too_large", saved.too_large},
                         {"bytes", saved.bytes}};
  live["recorder"] = recorderOf(recorder_);
  for (const io::DeviceHealth& device : deviceHealth())
    live["devices"][std::string(device.name)] = deviceOf(device);
  if (modem_) {
    const ModemThread::Counters& m = modem_->counters();
    live["devices"]["modem"] = {{"sent", m.sent.load()},
                                {"refused", m.refused.load()},
                                {"received", m.received.load()},
                                {"dropped", m.dropped.load()}};
  }
  for (const ThreadFigures& thread : final_cpu_) live["cpu_s"][thread.name] = thread.cpu_s;
  live["memory"] = memoryOf(budget_);
  live["memory"]["resident_at_arming_mib"] = static_cast<double>(resident_at_arming_) / kMiB;
  live["memory"]["heap_in_use_of_reserve_mib"] = static_cast<double>(heap_used_) / kMiB;
  live["memory"]["heap_beyond_reserve_mib"] = static_cast<double>(heap_overflow_) / kMiB;
  for (std::size_t i = 0; i < watchdog_.tiers(); ++i) {
    const rt::Watchdog::TierState& tier = watchdog_.state(i);
    live["watchdog"][tier.spec.name] = {{"times_stuck", tier.times_stuck},
                                        {"restarts", tier.restarts},
                                        {"longest_silent_ms", milliseconds(tier.longest_silent_ns)}};
  }
  output_->writeText("live.json", live.dump(2) + "\n");
  output_->commit();
  return true;
}

}  // namespace fathom::onboard
