#include "realtime/onboard/live/live_system.hpp"

#include <algorithm>
#include <ctime>
#include <functional>

#include "realtime/kernel/memory/process_memory.hpp"
#include "realtime/kernel/state_archive.hpp"
#include "realtime/onboard/map/mesh_slot.hpp"
#include "telemetry/wire/status.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kRestNs = 2'000'000;  // of a tier that found nothing to do
constexpr std::int64_t kRecorderRestNs = 10'000'000;
constexpr std::int64_t kCheckpointRestNs = 100'000'000;
constexpr std::int64_t kCameraSearchNs =
    10'000'000'000;  // that a camera's thread may be away for, looking for it
constexpr int kRecorderBudgetMs = 50;
constexpr std::size_t kInputsAtOnce = 64;            // of the soft tier, between two heartbeats
constexpr std::int64_t kClockStep_ns = 100'000'000;  // the system's clock was set, not steered
constexpr std::array<rt::StageSpec, 1> kRecorderStages = {{{"write", 0}}};

void restFor(std::int64_t ns) {
  const timespec pause = {0, static_cast<long>(ns)};
  ::clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, nullptr);
}

// Frames of a camera that the soft tier may hold: what the pool has beyond the recorder's share.
std::size_t heldFrames(io::CameraSource& camera, const io::RecorderConfig& recorder) {
  const std::size_t blocks = camera.pool().blocks();
  return blocks > recorder.image_queue + 2 ? blocks - recorder.image_queue - 1 : 2;
}

std::filesystem::path stateFolder(const std::filesystem::path& mission) {
  return mission / "state";
}

std::int64_t pairPeriod(const io::MissionConfig& mission) {
  return static_cast<std::int64_t>(1e9 / mission.cameras.rate_hz);
}

}  // namespace

LiveSystem::Slots LiveSystem::makeSlots(const LiveSetup& setup, bool reopen) {
  const OnboardConfig& c = setup.config;
  if (!c.localisation.enabled) return {};
  const std::filesystem::path folder = c.slot_folder.empty() ? stateFolder(setup.folder) : c.slot_folder;
  const auto feature_bytes = closure::slotBytes(closure::DescriptorKind::kRootSift,
                                                static_cast<std::size_t>(c.localisation.features));
  return {std::make_unique<SlotFile>(SlotFile::Named{folder / "features.slots", reopen},
                                     static_cast<std::size_t>(c.localisation.max_keyframes), feature_bytes),
          std::make_unique<SlotFile>(SlotFile::Named{folder / "meshes.slots", reopen},
                                     static_cast<std::size_t>(c.max_pairs),
                                     meshSlotBytes(static_cast<std::size_t>(c.stereo.max_features)))};
}

std::unique_ptr<OnboardOutput> LiveSystem::makeOutput(const LiveSetup& setup, bool reopen) {
  return std::make_unique<OnboardOutput>(io::MissionPaths(setup.folder).onboard(), setup.mission.origin,
                                         OutputFolder::Life{true, reopen},
                                         setup.config.live.recorder.planned_hours);
}

LiveSystem::LiveSystem(LiveSetup setup, LiveDevices devices, rt::VehicleClock& clock)
    : setup_(std::move(setup)),
      devices_(std::move(devices)),
      clock_(clock),
      budget_(setup_.config.live.memory.budget_bytes),
      hard_stages_(HardTier::kStageSpecs, &hard_track_),
      soft_stages_(SoftTier::stageSpecs(), &soft_track_),
      recorder_stages_(kRecorderStages, &recorder_track_),
      recorder_(
          setup_.folder, setup_.mission, setup_.rig, setup_.config.live.recorder,
          [this](const io::CameraFrame& f) {
            return (f.side == CameraSide::kLeft ? devices_.left : devices_.right)->view(f);
          },
          [this](const io::CameraFrame& f) {
            (f.side == CameraSide::kLeft ? devices_.left : devices_.right)->pool().release(f.block);
          }),
      modem_port_(modem_ring_),
      checkpoint_files_(stateFolder(setup_.folder)),
      names_(checkpointNames(setup_.folder, setup_.config, setup_.mission)),
      resume_(readResume(setup_.folder, checkpoint_files_, names_)),
      output_(makeOutput(setup_, resume_.checkpoint.has_value())),
      slots_(makeSlots(setup_, resume_.checkpoint.has_value())),
      recorded_(io::MissionPaths(setup_.folder), setup_.mission, setup_.rig),
      recorded_source_(recorded_.source()),
      frames_(frame_rings_[0], *devices_.left, frame_rings_[1], *devices_.right,
              std::min(heldFrames(*devices_.left, setup_.config.live.recorder),
                       heldFrames(*devices_.right, setup_.config.live.recorder))),
      run_(makeRun()),
      hard_(navCoreConfig(setup_.config, setup_.mission), {&recorder_, &sequence_}, clock_, hard_stages_) {
  resume();
  checkpoints_ = std::make_unique<CheckpointWriter>(checkpoint_files_, setup_.config.live.checkpoint_bytes,
                                                    checkpointNeeds());
  soft_ = std::make_unique<SoftTier>(
      *run_,
      SoftTier::Links{&sequence_, &frames_, &recorder_, &modem_port_, checkpoints_.get(), names_,
                      [this](const std::string& name, CameraSide side) { return hasPixels(name, side); }},
      setup_.config.live.overload, pairPeriod(setup_.mission), clock_, soft_stages_);
  if (resumed_) soft_->catchUpWith(std::move(resume_));
  for (InputRing& ring : own_rings_) hard_.sequencer().add(ring);
  planThreads();
  planMemory();
}

std::size_t LiveSystem::watch(const char* name, bool restartable, bool vital, std::int64_t least_ns) {
  return watchdog_.add(
      {name, std::max(setup_.config.live.realtime.stuck_after_ns, least_ns), restartable, vital});
}

void LiveSystem::addWorker(rt::Tier tier, const char* name, std::size_t watched, std::function<void()> body) {
  workers_.push_back(
      {std::make_unique<rt::RtThread>(rt::threadConfig(setup_.config.live.realtime, tier, name)),
       std::move(body), watched, name});
}

void LiveSystem::planThreads() {
  const std::size_t recording = watch("recorder", true, true);
  addWorker(rt::Tier::kBestEffort, "recorder", recording, [this] { runRecorder(); });
  const std::size_t vision = watch("vision", false, false);
  addWorker(rt::Tier::kSoft, "vision", vision, [this] { runSoft(); });
  for (const auto& source : devices_.samples) {
    Sample& sample = samples_.emplace_back();
    hard_.sequencer().add(sample.ring);
    const io::DeviceHealth health = source->health();
    const std::size_t tier = watch(health.name.data(), true, false);
    sample.thread = std::make_unique<SampleThread>(
        *source, SampleThread::Links{&sample.ring, &recorder_, lanes_++, &watchdog_.heartbeat(tier)}, clock_);
    addWorker(rt::Tier::kDevice, health.name.data(), tier,
              [this, &sample] { sample.thread->run(stop_devices_); });
  }
  const auto camera = [&](std::size_t i, const char* name, io::CameraSource& source,
                          std::unique_ptr<CameraThread>& to) {
    const std::size_t tier = watch(name, true, false, kCameraSearchNs);
    to = std::make_unique<CameraThread>(
        source, CameraThread::Links{&own_rings_[i], &frame_rings_[i], &recorder_, &watchdog_.heartbeat(tier)},
        clock_);
    addWorker(rt::Tier::kCamera, name, tier, [this, &to] { to->run(stop_devices_); });
  };
  camera(0, "left camera", *devices_.left, left_);
  camera(1, "right camera", *devices_.right, right_);
  if (devices_.modem) {
    const std::size_t tier = watch("modem", true, false);
    modem_ = std::make_unique<ModemThread>(
        *devices_.modem,
        ModemThread::Links{&modem_ring_, &own_rings_[2], &recorder_, lanes_++, &watchdog_.heartbeat(tier)},
        clock_);
    addWorker(rt::Tier::kBestEffort, "modem", tier, [this] { modem_->run(stop_modem_); });
  }
  const std::size_t navigation = watch("navigation", false, true);
  addBestEffort(
      "checkpoints", [this] { writeCheckpoint(); }, kCheckpointRestNs);
  addWorker(rt::Tier::kHard, "navigation", navigation,
            [this, navigation] { runHard(watchdog_.heartbeat(navigation)); });
}

std::size_t LiveSystem::addBestEffort(const char* name, std::function<void()> step, std::int64_t rest_ns) {
  const std::size_t tier = watch(name, true, false);
  rt::Heartbeat& heart = watchdog_.heartbeat(tier);
  addWorker(rt::Tier::kBestEffort, name, tier, [this, &heart, step = std::move(step), rest_ns] {
    while (!stop_devices_.load(std::memory_order_acquire)) {
      step();
      heart.beat(clock_.monotonicNs());
      restFor(rest_ns);
    }
  });
  return lanes_++;
}

void LiveSystem::runHard(rt::Heartbeat& heart) {
  while (!go_.load(std::memory_order_acquire)) restFor(kRestNs);
  loop_.emplace(clock_, setup_.config.live.realtime.period_ns);
  first_deadline_ns_.store(loop_->nextDeadlineNs(), std::memory_order_relaxed);
  // The first cycles touch what was never touched before.
  constexpr int kWarmCycles = 50;
  int cycles = 0;
  rt::ThreadCost before = rt::threadCost();
  loop_->run([&] {
    hard_.cycle();
    heart.beat(clock_.monotonicNs());
    if (++cycles % kWarmCycles == 0) {
      hard_stages_.publish();
      if (cycles == kWarmCycles) before = rt::threadCost();
      const rt::ThreadCost cost = rt::threadCost() - before;
      hard_heap_calls_.store(cost.heap_calls, std::memory_order_relaxed);
      hard_minor_faults_.store(cost.minor_faults, std::memory_order_relaxed);
      hard_slipped_.store(loop_->statistics().slipped_cycles, std::memory_order_relaxed);
      hard_major_faults_.store(cost.major_faults, std::memory_order_relaxed);
    }
    return !stop_hard_.load(std::memory_order_acquire);
  });
}

void LiveSystem::runSoft() {
  rt::Heartbeat& heart = watchdog_.heartbeat(workers_[1].tier);
  while (!stop_soft_.load(std::memory_order_acquire)) {
    const std::size_t done = soft_->work(kInputsAtOnce);
    heart.beat(clock_.monotonicNs());
    if (soft_->ended()) break;
    if (done == 0) restFor(kRestNs);
  }
  if (soft_->ended()) run_->finish(0);
  soft_done_.store(true, std::memory_order_release);
}

void LiveSystem::runRecorder() {
  rt::Heartbeat& heart = watchdog_.heartbeat(workers_[0].tier);
  while (!stop_recorder_.load(std::memory_order_acquire)) {
    const std::int64_t begin = clock_.monotonicNs();
    const std::uint64_t bytes = recorder_.counters().bytes;
    const bool more = recorder_.work(kRecorderBudgetMs);
    if (recorder_.counters().bytes != bytes) recorder_stages_.add(0, begin, clock_.monotonicNs());
    recorder_stages_.publish();
    heart.beat(clock_.monotonicNs());
    if (!more) restFor(kRecorderRestNs);
  }
}

rt::ArmingResult LiveSystem::arm(rt::HeapReserve& heap) {
  for (Worker& worker : workers_) (void)worker.thread->start(worker.body);
  arming_ = rt::arm(setup_.config.live.realtime, budget_, heap, setup_.config.live.memory.heap_bytes);
  if (!arming_.armed()) return arming_;
  heap_ = &heap;
  resident_at_arming_ = rt::exactResidentBytes();
  begun_mono_ns_ = clock_.monotonicNs();
  if (resumed_) away_ns_ = std::max<std::int64_t>(0, clock_.utcNs() - away_since_ns_);
  next_checkpoint_ns_ = begun_mono_ns_ + static_cast<std::int64_t>(setup_.config.live.checkpoint_s * 1e9);
  for (const Worker& worker : workers_) watchdog_.watch(worker.tier, begun_mono_ns_);
  (void)hard_.mark({io::Mark::Kind::kHealth, roof_health_ = roofHealth()});
  go_.store(true, std::memory_order_release);
  return arming_;
}

std::uint64_t LiveSystem::roofHealth() {
  std::uint64_t flags = hard_slipped_.load(std::memory_order_relaxed) << 16U;
  if (!arming_.complete()) flags |= telemetry::kHealthSoftRealTime;
  if (soft_->overload().level() != rt::DegradationLevel::kFull) flags |= telemetry::kHealthOverload;
  const io::Recorder::Counters recorded = recorder_.counters();
  if (recorded.inputs_dropped + recorded.decisions_dropped + recorded.images_dropped_disk +
          recorded.images_dropped_queue + recorded.write_failures >
      0)
    flags |= telemetry::kHealthRecorderFailed;
  if (recorder_.disk() != io::Recorder::Disk::kRoom) flags |= telemetry::kHealthDiskLow;
  return flags;
}

std::vector<std::string> LiveSystem::supervise() {
  std::vector<std::string> events;
  watchdog_.step(clock_.monotonicNs(), [&](std::size_t tier, rt::Watchdog::Remedy remedy) {
    const auto of =
        std::find_if(workers_.begin(), workers_.end(), [&](const Worker& w) { return w.tier == tier; });
    if (of == workers_.end()) return;
    switch (remedy) {
      case rt::Watchdog::Remedy::kRestart:
        // A body that has left is started again; one that hangs in a system call cannot be taken away.
        events.push_back(of->name + " is stuck" +
                         (!of->thread->running() && of->thread->start(of->body) ? "; started again" : ""));
        break;
      case rt::Watchdog::Remedy::kGiveUp:
        events.push_back(of->name + " is stuck; going on without it");
        break;
      case rt::Watchdog::Remedy::kRecovered:
        events.push_back(of->name + " is alive again");
        break;
    }
  });
  const std::int64_t step = clock_.systemStepNs();
  if (std::abs(step - last_step_ns_) > kClockStep_ns) {
    ++clock_steps_;
    events.push_back("the system's clock was set by " +
                     std::to_string(static_cast<double>(step - last_step_ns_) * 1e-9) +
                     " s; the vehicle's time goes on unchanged");
  }
  last_step_ns_ = step;
  const std::int64_t now = clock_.monotonicNs();
  if (now >= next_checkpoint_ns_ && soft_->caughtUp() &&
      hard_.mark({io::Mark::Kind::kCheckpoint, next_checkpoint_})) {
    ++next_checkpoint_;
    next_checkpoint_ns_ = now + static_cast<std::int64_t>(setup_.config.live.checkpoint_s * 1e9);
  }
  const std::uint64_t health = roofHealth();
  if (health != roof_health_ && hard_.mark({io::Mark::Kind::kHealth, health})) roof_health_ = health;
  return events;
}

void LiveSystem::joinAll() {
  for (Worker& worker : workers_) worker.thread->join();
}

void LiveSystem::stop() {
  if (stopped_) return;
  final_cpu_ = cpuTimes();
  if (heap_ != nullptr) {
    heap_used_ = heap_->usedOfReserve();
    heap_overflow_ = heap_->overflowBytes();
  }
  for (std::size_t i = 0; i < watchdog_.tiers(); ++i) watchdog_.unwatch(i);
  stop_devices_ = true;
  for (std::size_t i = 2; i < workers_.size(); ++i)
    if (workers_[i].name != "modem" && workers_[i].name != "navigation") workers_[i].thread->join();
  while (!hard_.mark({io::Mark::Kind::kEnd, 0})) restFor(kRestNs);
  while (!hard_.ended()) restFor(kRestNs);
  stop_hard_ = true;
  while (!soft_done_.load(std::memory_order_acquire)) restFor(kRestNs);
  stop_soft_ = stop_modem_ = stop_recorder_ = true;
  joinAll();
  recorder_.close();
  stopped_ = true;
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
  return all;
}

}  // namespace fathom::onboard
