#include "realtime/onboard/live/live_system.hpp"

#include <sys/wait.h>

#include <algorithm>
#include <cstdio>
#include <functional>

#include "realtime/base/units.hpp"
#include "realtime/kernel/fault_point.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/threads/service_notify.hpp"
#include "realtime/onboard/live/watched_threads.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kRecorderRestNs = 10'000'000;
constexpr std::int64_t kCameraSearchNs =
    10'000'000'000;  // that a camera's thread may be away for, looking for it
constexpr int kRecorderBudgetMs = 50;
constexpr std::int64_t kWatchdogRestNs = 200'000'000;
constexpr std::int64_t kMapperPlanNs = 20'000'000'000;  // that a dive that begins waits for the mapper's plan
constexpr std::array<rt::StageSpec, 1> kRecorderStages = {{{"write", 0}}};

// Frames of a camera that may be lent to the mapper: what the pool has beyond the recorder's share.
std::size_t lentFrames(io::CameraSource& camera, const io::RecorderConfig& recorder) {
  const std::size_t blocks = camera.pool().blocks();
  return blocks > recorder.image_queue + 2 ? blocks - recorder.image_queue - 1 : 2;
}

MapperKeeper::Config keeperConfig(const rt::RealtimeConfig& realtime) {
  MapperKeeper::Config config;
  config.stuck_after_ns = realtime.stuck_after_ns;
  config.start_within_ns = std::max(config.start_within_ns, realtime.stuck_after_ns);
  return config;
}

OwnStatus::Config ownStatusConfig(const LiveSetup& setup) {
  const telemetry::LinkSchedulerConfig& link = setup.config.link.scheduler;
  OwnStatus::Config config;
  config.identity = {setup.mission.vehicle_id, setup.mission.dive_id};
  config.tag = telemetry::FrameTag(setup.config.link_key);
  config.first = telemetry::firstVersion(setup.mission.start_utc_ns);
  if (link.padded) config.padded_bytes = static_cast<std::size_t>(link.modem_bytes);
  // A bundle of the shortest frames more.
  config.passed_over = static_cast<std::uint16_t>(
      config.passed_over + static_cast<std::size_t>(link.modem_bytes) / telemetry::kMinFrameBytes);
  return config;
}

}  // namespace

LiveSystem::LiveSystem(LiveSetup setup, LiveDevices devices, rt::VehicleClock& clock)
    : setup_(std::move(setup)),
      devices_(std::move(devices)),
      clock_(clock),
      budget_(setup_.config.live.memory.budget_bytes),
      hard_stages_(HardTier::kStageSpecs, &hard_track_),
      recorder_stages_(kRecorderStages, &recorder_track_),
      names_(checkpointNames(setup_.folder, setup_.config, setup_.mission)),
      recorder_(
          setup_.folder, setup_.mission, setup_.rig, setup_.config.live.recorder,
          [this](const io::CameraFrame& f) {
            return (f.side == CameraSide::kLeft ? devices_.left : devices_.right)->view(f);
          },
          [this](const io::CameraFrame& f) {
            (f.side == CameraSide::kLeft ? devices_.left : devices_.right)->pool().release(f.block);
          }),
      own_status_(ownStatusConfig(setup_)),
      hard_(navCoreConfig(setup_.config, setup_.mission), {&recorder_, &channel_.down().inputs}, clock_,
            hard_stages_),
      resume_(resumeNavigation(setup_.folder, names_, hard_)),
      threads_(setup_.config.live.realtime),
      hung_restarts_(stateFolder(setup_.folder)) {
  hard_.sequencer().startAfter(resume_.last_ns);
  recorder_.setFirstPosition(resume_.position);
  shareWithMapper();
  child_ = std::make_unique<MapperChild>(childStart(false));
  supervisor_.emplace(Supervisor::Links{&threads_, &hard_, &recorder_, &clock_, &channel_, child_.get(),
                                        &own_status_, &parts_, [this] { return deviceHealth(); }},
                      keeperConfig(setup_.config.live.realtime), setup_.config.live.checkpoint_s,
                      resume_.newest_checkpoint + 1);
  for (InputRing& ring : own_rings_) hard_.sequencer().add(ring);
  planThreads();
}

void LiveSystem::shareWithMapper() {
  MapperDown& down = channel_.down();
  down.clock = clock_.setting();
  down.configuration = names_.configuration;
  down.mission = names_.mission;
  down.inputs.start(resume_.position);
  down.safe_position.store(resume_.position);
  down.fresh.store(!resume_.any());
  const std::size_t most = std::min(lentFrames(*devices_.left, setup_.config.live.recorder),
                                    lentFrames(*devices_.right, setup_.config.live.recorder));
  down.most_held = most > 4 ? most - 2 : 2;
  const std::array<io::CameraSource*, 2> cameras = {devices_.left.get(), devices_.right.get()};
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const rt::SharedBlocks& pool = cameras[i]->pool();
    down.pools[i] = {pool.memory().bytes(), pool.stride(), pool.blocks()};
  }
  left_frames_.emplace(*devices_.left, down.frames[0], channel_.up().frame_floor[0], most);
  right_frames_.emplace(*devices_.right, down.frames[1], channel_.up().frame_floor[1], most);
}

MapperChild::Start LiveSystem::childStart(bool plan) const {
  MapperChild::Start start;
  start.program = setup_.mapper_program;
  start.arguments = {"--mapper", std::filesystem::absolute(setup_.folder).string()};
  if (setup_.config_file) {
    start.arguments.emplace_back("--config");
    start.arguments.push_back(std::filesystem::absolute(*setup_.config_file).string());
  }
  if (setup_.config.live.realtime.soft) start.arguments.emplace_back("--soft");
  if (plan) start.arguments.emplace_back("--print-budget");
  start.files = {channel_.downFile(), channel_.upFile(), devices_.left->pool().memory().file(),
                 devices_.right->pool().memory().file()};
  return start;
}

void LiveSystem::planThreads() {
  using Watch = WatchedThreads::Watch;
  // Recording is worth much; navigation more: a disk that stalls must not end it.
  threads_.add(rt::Tier::kBestEffort, "recorder", Watch{true, 0, true},
               [this](auto& heart) { runRecorder(heart); });
  for (const auto& source : devices_.samples) {
    Sample& sample = samples_.emplace_back();
    hard_.sequencer().add(sample.ring);
    rt::Heartbeat& heart = threads_.add(rt::Tier::kDevice, source->health().name.data(), Watch{},
                                        [this, &sample](auto&) { sample.thread->run(stop_devices_); });
    sample.thread = std::make_unique<SampleThread>(
        *source, SampleThread::Links{&sample.ring, &recorder_, lanes_++, &heart}, clock_);
  }
  const auto camera = [&](std::size_t i, const char* name, io::CameraSource& source, FrameLender& frames,
                          std::unique_ptr<CameraThread>& to) {
    rt::Heartbeat& heart = threads_.add(rt::Tier::kCamera, name, Watch{true, kCameraSearchNs},
                                        [this, &to](auto&) { to->run(stop_devices_); });
    to = std::make_unique<CameraThread>(
        source, CameraThread::Links{&own_rings_[i], &frames, &recorder_, &heart}, clock_);
  };
  camera(0, "left camera", *devices_.left, *left_frames_, left_);
  camera(1, "right camera", *devices_.right, *right_frames_, right_);
  if (devices_.modem) {
    rt::Heartbeat& heart =
        threads_.add(rt::Tier::kBestEffort, "modem", Watch{}, [this](auto&) { modem_->run(stop_modem_); });
    modem_ = std::make_unique<ModemThread>(
        *devices_.modem,
        ModemThread::Links{&channel_.up().modem, &own_status_, &own_rings_[2], &recorder_, lanes_++, &heart},
        clock_);
  }
  navigation_ =
      &threads_.add(rt::Tier::kHard, "navigation", Watch{false}, [this](auto& heart) { navigate(heart); });
  threads_.add(rt::Tier::kBestEffort, "watchdog", Watch{}, [this](auto& heart) { runWatchdog(heart); });
}

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
  budget_.addFixed("shared with the mapper", channel_.bytes());
  budget_.addFixed("rings of devices", sizeof(own_rings_) + samples_.size() * sizeof(InputRing));
  budget_.addFixed("recorder",
                   setup_.config.live.recorder.raw_lanes * setup_.config.live.recorder.raw_queue_kib * 1024);
  budget_.addFixed("stacks", threads_.stackBytes());
  budget_.addFixed("heap of devices and reports", setup_.config.live.memory.vehicle_heap_bytes);
  // What is not above and lives as long as the program. Memory that is free again is part of the heap's
  // reserve; what is shared is in the lines above.
  const std::size_t shared =
      channel_.bytes() + devices_.left->pool().memory().bytes() + devices_.right->pool().memory().bytes();
  const std::size_t heap_free = rt::HeapReserve::heapBytes() - rt::HeapReserve::usedBytes();
  const std::size_t planned =
      budget_.plannedBytes() - shared - setup_.config.live.memory.vehicle_heap_bytes + heap_free;
  const std::size_t mapped = rt::mappedPrivateBytes();
  if (mapped > planned) budget_.addFixed("devices' own", mapped - planned);
  // Locked memory makes all of it resident; the mapper has the same pages.
  budget_.addFixed("program and libraries", rt::mappedFileBytes());
}

void LiveSystem::addMapperToBudget() {
  const std::int64_t until = clock_.monotonicNs() + kMapperPlanNs;
  MapperFigures figures;
  const auto planned = [&] { return channel_.up().figures.read(figures) && figures.planned > 0; };
  // One that cannot even begin is not waited for: it is tried again while the vehicle navigates.
  constexpr std::uint64_t kTries = 3;
  const auto known = [&] {
    supervisor_->stepMapper(early_events_);
    return planned() || supervisor_->mapperStarts() > kTries;
  };
  (void)waitFor(known, until);
  budget_.add("mapper process", planned() ? figures.planned : 0, [this] {
    MapperFigures now;
    (void)channel_.up().figures.read(now);
    return rt::PoolUse{now.own, now.own, 0};
  });
}

std::size_t LiveSystem::addBestEffort(const char* name, std::function<void()> step,
                                      std::function<std::int64_t()> rest_ns) {
  threads_.add(rt::Tier::kBestEffort, name, {},
               [this, name, step = std::move(step), rest = std::move(rest_ns)](rt::Heartbeat& heart) {
                 while (!stop_devices_.load(std::memory_order_acquire)) {
                   rt::faultPoint(name);
                   step();
                   heart.beat(clock_.monotonicNs());
                   rt::restFor(rest());
                 }
               });
  return lanes_++;
}

// Nothing works without navigation, and nothing else of this process can take its place.
void LiveSystem::navigate(rt::Heartbeat& heart) {
  try {
    runHard(heart);
  } catch (const std::exception& e) {
    if (setup_.lost) setup_.lost(std::string("navigation failed (") + e.what() + ")");
    throw;
  }
}

void LiveSystem::runHard(rt::Heartbeat& heart) {
  while (!go_.load(std::memory_order_acquire)) {
    if (stop_hard_.load(std::memory_order_acquire)) return;
    rt::restFor(rt::kPollRest_ns);
  }
  loop_.emplace(clock_, setup_.config.live.realtime.period_ns);
  first_deadline_ns_.store(loop_->nextDeadlineNs(), std::memory_order_relaxed);
  // The first cycles touch what was never touched before.
  constexpr int kWarmCycles = 50;
  int cycles = 0;
  rt::ThreadCost before = rt::threadCost();
  loop_->run([&] {
    rt::faultPoint("navigation");
    hard_.cycle();
    heart.beat(clock_.monotonicNs());
    if (++cycles % kWarmCycles == 0) {
      hard_stages_.publish();
      if (cycles == kWarmCycles) before = rt::threadCost();
      const rt::ThreadCost cost = rt::threadCost() - before;
      hard_heap_calls_.store(cost.heap_calls, std::memory_order_relaxed);
      hard_minor_faults_.store(cost.minor_faults, std::memory_order_relaxed);
      hard_skipped_.store(loop_->statistics().skipped_cycles, std::memory_order_relaxed);
      hard_major_faults_.store(cost.major_faults, std::memory_order_relaxed);
    }
    return !stop_hard_.load(std::memory_order_acquire);
  });
}

// What a mapper decided goes to the log, and what the disk holds of the log to the mapper. On the recorder's
// thread: a disk that stalls it holds up nothing that this is for.
void LiveSystem::takeFromMapper() {
  PairDecision decision;
  // Another process may push for ever.
  for (std::size_t i = 0; i < channel_.up().decisions.capacity() && channel_.up().decisions.pop(decision);
       ++i)
    (void)recorder_.offerDecision({decision.utc_ns, decision.decision});
  const io::Recorder::Counters c = recorder_.counters();
  channel_.down().safe_position.store(c.safe_position, std::memory_order_relaxed);
  channel_.down().decisions_safe.store(c.decisions_safe, std::memory_order_relaxed);
}

void LiveSystem::runRecorder(rt::Heartbeat& heart) {
  while (!stop_recorder_.load(std::memory_order_acquire)) {
    const std::int64_t begin = clock_.monotonicNs();
    const std::uint64_t bytes = recorder_.counters().bytes;
    rt::faultPoint("recorder");
    takeFromMapper();
    const bool more = recorder_.work(kRecorderBudgetMs);
    if (recorder_.counters().bytes != bytes) recorder_stages_.add(0, begin, clock_.monotonicNs());
    recorder_stages_.publish();
    heart.beat(clock_.monotonicNs());
    if (!more) rt::restFor(kRecorderRestNs);
  }
}

// From a thread of its own, so that nothing that others wait for holds it up.
void LiveSystem::runWatchdog(rt::Heartbeat& heart) {
  const std::int64_t stuck_ns = setup_.config.live.realtime.stuck_after_ns;
  ProgramWatch watch({stuck_ns, std::max(2 * stuck_ns, ProgramWatch::Config{}.supervisor_ns)});
  for (; !ends_.load(std::memory_order_acquire); rt::restFor(kWatchdogRestNs)) {
    heart.beat(clock_.monotonicNs());
    if (!go_.load(std::memory_order_acquire)) continue;
    const std::string why =
        watch.look(clock_.monotonicNs(), navigation_->beats(), supervised_.load(std::memory_order_relaxed));
    if (watch.alive()) rt::ServiceNotify::alive();
    // What the supervisor says may wait for the disk too; navigation never does.
    const bool lost = !why.empty() && (!watch.alive() || !HungRestarts::waitsForDisk());
    if (lost && setup_.lost && !ends_.load(std::memory_order_acquire)) setup_.lost(why);
  }
}

rt::ArmingResult LiveSystem::arm() {
  planMemory();
  supervisor_->stepMapper(early_events_);
  for (const std::string& name : threads_.start()) parts_.set(name, PartState::kFailed, "no thread");
  if (!resumed()) addMapperToBudget();
  arming_ =
      rt::arm(setup_.config.live.realtime, budget_, heap_, setup_.config.live.memory.vehicle_heap_bytes);
  if (!arming_.armed()) return arming_;
  complete_.store(arming_.complete(), std::memory_order_relaxed);
  measured_.resident_at_arming = rt::exactResidentBytes();
  begun_mono_ns_ = clock_.monotonicNs();
  if (resumed()) away_ns_ = std::max<std::int64_t>(0, clock_.utcNs() - resume_.last_ns);
  supervisor_->begin(complete());
  go_.store(true, std::memory_order_release);
  return arming_;
}

int LiveSystem::printBudget() {
  planMemory();
  std::fprintf(stderr, "vehicle process\n%s", budget_.table(false).c_str());
  MapperChild plan(childStart(true));
  if (!plan.start().empty()) return -1;
  int status = 0;
  if (::waitpid(plan.pid(), &status, 0) < 0 || !WIFEXITED(status)) return -1;
  if (WEXITSTATUS(status) != 0) return WEXITSTATUS(status);
  MapperFigures figures;
  (void)channel_.up().figures.read(figures);
  const std::size_t both = budget_.plannedBytes() + figures.planned;
  std::fprintf(stderr, "both processes %.2f of %.2f MiB, %s\n", mebibytes(both),
               mebibytes(budget_.budgetBytes()), both <= budget_.budgetBytes() ? "fits" : "does not fit");
  return 0;
}

std::vector<std::string> LiveSystem::supervise() {
  supervised_.fetch_add(1, std::memory_order_relaxed);
  std::vector<std::string> events;
  try {
    events = supervisor_->step(hard_skipped_.load(std::memory_order_relaxed));
    endIfHanging();
  } catch (const std::exception& e) {
    events.push_back(std::string("the supervisor failed (") + e.what() + "); it continues");
  }
  events.insert(events.begin(), early_events_.begin(), early_events_.end());
  early_events_.clear();
  return events;
}

void LiveSystem::endIfHanging() {
  if (!setup_.lost) return;
  const std::string name =
      threads_.hanging([this](std::int64_t limit_ns) { return hung_restarts_.patienceNs(limit_ns); });
  if (!name.empty() && !HungRestarts::waitsForDisk() && hung_restarts_.note()) setup_.lost(name + " hangs");
}

rt::ThreadCost LiveSystem::hardCost() const {
  return {hard_heap_calls_.load(std::memory_order_relaxed),
          hard_minor_faults_.load(std::memory_order_relaxed),
          hard_major_faults_.load(std::memory_order_relaxed)};
}

std::vector<io::DeviceHealth> LiveSystem::deviceHealth() const {
  std::vector<io::DeviceHealth> all;
  for (const Sample& sample : samples_) all.push_back(sample.thread->health());
  all.push_back(left_->health());
  all.push_back(right_->health());
  if (modem_) all.push_back(modem_->health());
  return all;
}

std::uint64_t LiveSystem::framesNotLent() const {
  return left_frames_->refused() + right_frames_->refused();
}

}  // namespace fathom::onboard
