#include "realtime/onboard/live/live_system.hpp"

#include <algorithm>
#include <ctime>
#include <functional>

#include "realtime/kernel/memory/process_memory.hpp"
#include "realtime/kernel/seconds.hpp"
#include "realtime/kernel/state_archive.hpp"
#include "realtime/onboard/map/mesh_slot.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kRestNs = 2'000'000;  // of a tier that found nothing to do
constexpr std::int64_t kRecorderRestNs = 10'000'000;
constexpr std::int64_t kCheckpointRestNs = 100'000'000;
constexpr std::int64_t kCameraSearchNs =
    10'000'000'000;  // that a camera's thread may be away for, looking for it
constexpr int kRecorderBudgetMs = 50;
constexpr double kMostCloseS = 60;         // the recorder at the end of the survey
constexpr std::size_t kInputsAtOnce = 64;  // of the soft tier, between two heartbeats
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
      hard_(navCoreConfig(setup_.config, setup_.mission), {&recorder_, &sequence_}, clock_, hard_stages_),
      threads_(setup_.config.live.realtime) {
  resume();
  checkpoints_ = std::make_unique<CheckpointWriter>(checkpoint_files_, setup_.config.live.checkpoint_bytes,
                                                    checkpointNeeds());
  soft_ = std::make_unique<SoftTier>(
      *run_,
      SoftTier::Links{&sequence_, &frames_, &recorder_, &modem_port_, checkpoints_.get(), names_,
                      [this](const std::string& name, CameraSide side) { return hasPixels(name, side); }},
      setup_.config.live.overload, pairPeriod(setup_.mission), clock_, soft_stages_);
  if (resumed_) soft_->catchUpWith(std::move(resume_));
  supervisor_.emplace(Supervisor::Links{&threads_, &hard_, soft_.get(), &recorder_, &clock_},
                      setup_.config.live.checkpoint_s, next_checkpoint_);
  for (InputRing& ring : own_rings_) hard_.sequencer().add(ring);
  planThreads();
  planMemory();
}

void LiveSystem::planThreads() {
  using Watch = WatchedThreads::Watch;
  threads_.add(rt::Tier::kBestEffort, "recorder", Watch{true, true},
               [this](auto& heart) { runRecorder(heart); });
  threads_.add(rt::Tier::kSoft, "vision", Watch{false, false}, [this](auto& heart) { runSoft(heart); });
  for (const auto& source : devices_.samples) {
    Sample& sample = samples_.emplace_back();
    hard_.sequencer().add(sample.ring);
    rt::Heartbeat& heart = threads_.add(rt::Tier::kDevice, source->health().name.data(), Watch{},
                                        [this, &sample](auto&) { sample.thread->run(stop_devices_); });
    sample.thread = std::make_unique<SampleThread>(
        *source, SampleThread::Links{&sample.ring, &recorder_, lanes_++, &heart}, clock_);
  }
  const auto camera = [&](std::size_t i, const char* name, io::CameraSource& source,
                          std::unique_ptr<CameraThread>& to) {
    rt::Heartbeat& heart = threads_.add(rt::Tier::kCamera, name, Watch{true, false, kCameraSearchNs},
                                        [this, &to](auto&) { to->run(stop_devices_); });
    to = std::make_unique<CameraThread>(
        source, CameraThread::Links{&own_rings_[i], &frame_rings_[i], &recorder_, &heart}, clock_);
  };
  camera(0, "left camera", *devices_.left, left_);
  camera(1, "right camera", *devices_.right, right_);
  if (devices_.modem) {
    rt::Heartbeat& heart =
        threads_.add(rt::Tier::kBestEffort, "modem", Watch{}, [this](auto&) { modem_->run(stop_modem_); });
    modem_ = std::make_unique<ModemThread>(
        *devices_.modem, ModemThread::Links{&modem_ring_, &own_rings_[2], &recorder_, lanes_++, &heart},
        clock_);
  }
  addBestEffort(
      "checkpoints", [this] { writeCheckpoint(); }, kCheckpointRestNs);
  threads_.add(rt::Tier::kHard, "navigation", Watch{false, true}, [this](auto& heart) { runHard(heart); });
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
  budget_.addFixed("stacks", threads_.stackBytes());
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

std::size_t LiveSystem::addBestEffort(const char* name, std::function<void()> step, std::int64_t rest_ns) {
  threads_.add(rt::Tier::kBestEffort, name, {},
               [this, step = std::move(step), rest_ns](rt::Heartbeat& heart) {
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

void LiveSystem::runSoft(rt::Heartbeat& heart) {
  while (!stop_soft_.load(std::memory_order_acquire)) {
    const std::size_t done = soft_->work(kInputsAtOnce);
    heart.beat(clock_.monotonicNs());
    if (soft_->ended()) break;
    if (done == 0) restFor(kRestNs);
  }
  if (soft_->ended()) run_->finish(0);
  soft_done_.store(true, std::memory_order_release);
}

void LiveSystem::runRecorder(rt::Heartbeat& heart) {
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

rt::ArmingResult LiveSystem::arm() {
  (void)threads_.start();
  arming_ = rt::arm(setup_.config.live.realtime, budget_, heap_, setup_.config.live.memory.heap_bytes);
  if (!arming_.armed()) return arming_;
  complete_.store(arming_.complete(), std::memory_order_relaxed);
  measured_.resident_at_arming = rt::exactResidentBytes();
  begun_mono_ns_ = clock_.monotonicNs();
  if (resumed_) away_ns_ = std::max<std::int64_t>(0, clock_.utcNs() - away_since_ns_);
  supervisor_->begin(complete());
  go_.store(true, std::memory_order_release);
  return arming_;
}

std::vector<std::string> LiveSystem::supervise() {
  return supervisor_->step(hard_slipped_.load(std::memory_order_relaxed));
}

void LiveSystem::stop() {
  if (stopped_) return;
  measured_.cpu = cpuTimes();
  if (go_.load(std::memory_order_relaxed)) {
    measured_.heap_used = heap_.usedOfReserve();
    measured_.heap_overflow = heap_.overflowBytes();
  }
  threads_.unwatch();
  stop_devices_ = true;
  threads_.joinAllBut({"recorder", "vision", "modem", "navigation"});
  while (!hard_.mark({io::Mark::Kind::kEnd, 0})) restFor(kRestNs);
  while (!hard_.ended()) restFor(kRestNs);
  stop_hard_ = true;
  while (!soft_done_.load(std::memory_order_acquire)) restFor(kRestNs);
  stop_soft_ = stop_modem_ = stop_recorder_ = true;
  threads_.joinAllBut({});
  (void)recorder_.close(kMostCloseS);
  stopped_ = true;
}

bool LiveSystem::write() {
  const double wall_s = rt::seconds(clock_.monotonicNs() - begun_mono_ns_);
  if (!run_->write(0, wall_s)) return false;
  output_->writeText("live.json", liveJson(*this, wall_s));
  output_->commit();
  return true;
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
