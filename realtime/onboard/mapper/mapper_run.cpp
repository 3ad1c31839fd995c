#include "realtime/onboard/mapper/mapper_run.hpp"

#include <algorithm>
#include <cstdio>
#include <fstream>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/fault_point.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/onboard/checkpoint/checkpoint_names.hpp"
#include "realtime/onboard/map/moving_map.hpp"

namespace fathom::onboard {
namespace {

constexpr std::size_t kInputsAtOnce = 64;  // between two looks at what else is to be done
constexpr std::size_t kLeastHeld = 2;
constexpr std::int64_t kDiskLookNs = 5'000'000'000;  // between two tries of a disk that refused rows

// A slot file that remembers that the disk refused it: what the map then lacks a replay would have.
class WatchedSlots final : public SlotStore {
 public:
  WatchedSlots(std::unique_ptr<SlotFile> file, bool& refused) : file_(std::move(file)), refused_(refused) {}
  [[nodiscard]] std::size_t slots() const override { return file_->slots(); }
  [[nodiscard]] std::size_t slotBytes() const override { return file_->slotBytes(); }
  [[nodiscard]] bool write(std::size_t slot, std::span<const std::uint8_t> data) override {
    return noted(file_->write(slot, data));
  }
  [[nodiscard]] bool read(std::size_t slot, std::span<std::uint8_t> data) override {
    return noted(file_->read(slot, data));
  }
  void mark(std::uint64_t number) override { file_->mark(number); }
  [[nodiscard]] bool needsCheck() const override { return file_->needsCheck(); }
  void checked() override { file_->checked(); }
  [[nodiscard]] bool rollBack(std::uint64_t number) override { return file_->rollBack(number); }
  void forget(std::uint64_t before) override { file_->forget(before); }

 private:
  bool noted(bool good) {
    refused_ = refused_ || !good;
    return good;
  }
  std::unique_ptr<SlotFile> file_;
  bool& refused_;
};

// Whether the disk takes a file in this folder now.
bool takesFiles(const std::filesystem::path& folder) {
  const std::filesystem::path probe = folder / "probe.tmp";
  std::error_code ignored;
  const bool good = static_cast<bool>(std::ofstream(probe) << "probe" << std::flush);
  std::filesystem::remove(probe, ignored);
  return good;
}

// Slots that take no room, for a plan.
class NoSlots final : public SlotStore {
 public:
  NoSlots(std::size_t slots, std::size_t slot_bytes) : slots_(slots), slot_bytes_(slot_bytes) {}
  [[nodiscard]] std::size_t slots() const override { return slots_; }
  [[nodiscard]] std::size_t slotBytes() const override { return slot_bytes_; }
  [[nodiscard]] bool write(std::size_t, std::span<const std::uint8_t>) override { return false; }
  [[nodiscard]] bool read(std::size_t, std::span<std::uint8_t>) override { return false; }

 private:
  std::size_t slots_, slot_bytes_;
};

}  // namespace

MapperRun::MapperRun(Setup setup, MapperChannel& channel, rt::Clock& clock)
    : setup_(std::move(setup)),
      channel_(channel),
      clock_(clock),
      budget_(setup_.config.live.memory.budget_bytes),
      files_(stateFolder(setup_.folder)),
      modem_(channel.up().modem),
      frames_(std::as_const(channel).down(), channel.up(), kMapperLeftPool, kMapperRightPool,
              std::max<std::size_t>(std::as_const(channel).down().most_held, kLeastHeld)),
      feed_(setup_.folder, std::as_const(channel).down()),
      recorded_(io::MissionPaths(setup_.folder), setup_.mission, setup_.rig),
      recorded_source_(recorded_.source()),
      begun_ns_(clock.monotonicNs()) {
  const MapperDown& down = std::as_const(channel_).down();
  std::vector<std::string> said;
  if (!down.from_empty.load()) heads_ = files_.usable(down.configuration, down.mission, said);
  for (const std::string& line : said) say(line);
  make(!heads_.empty());
  std::vector<std::filesystem::path> needs = output_->files();
  needs.insert(needs.end(), slot_paths_.begin(), slot_paths_.end());
  checkpoints_ = std::make_unique<CheckpointWriter>(files_, setup_.config.live.checkpoint_bytes, needs);
  planMemory();
}

void MapperRun::say(const std::string& line) const {
  std::fprintf(stderr, "fathom-onboard: %s\n", line.c_str());
}

std::unique_ptr<SlotStore> MapperRun::slots(const char* name, bool reopen, int slots,
                                            std::size_t slot_bytes) {
  const auto count = static_cast<std::size_t>(slots);
  if (setup_.plan_only) return std::make_unique<NoSlots>(count, slot_bytes);
  const std::filesystem::path& other = setup_.config.slot_folder;
  const std::filesystem::path file = (other.empty() ? stateFolder(setup_.folder) : other) / name;
  auto made = std::make_unique<SlotFile>(SlotFile::Named{file, reopen}, count, slot_bytes);
  slot_paths_.push_back(file);
  slot_paths_.push_back(made->journalPath());
  return std::make_unique<WatchedSlots>(std::move(made), slots_refused_);
}

void MapperRun::make(bool reopen) {
  tier_.reset();
  run_.reset();
  output_.reset();
  output_ = std::make_unique<OnboardOutput>(io::MissionPaths(setup_.folder).onboard(), setup_.mission.origin,
                                            OutputFolder::Life{true, reopen},
                                            setup_.plan_only ? 0 : setup_.config.live.recorder.planned_hours);
  const OnboardConfig& c = setup_.config;
  features_.reset();
  meshes_.reset();
  slot_paths_.clear();
  slots_refused_ = false;
  if (c.localisation.enabled) {
    features_ = slots("features.slots", reopen, c.localisation.max_keyframes,
                      closure::slotBytes(static_cast<std::size_t>(c.localisation.features)));
    meshes_ = slots("meshes.slots", reopen, c.max_pairs,
                    meshSlotBytes(static_cast<std::size_t>(c.stereo.max_features)));
  }
  MissionRun::Setup setup;
  setup.config = setup_.config;
  setup.mission = setup_.mission;
  setup.rig = setup_.rig;
  setup.pairs.images = [this](const std::string& name, CameraSide side) { return pixels(name, side); };
  setup.slots = {features_.get(), meshes_.get()};
  setup.link.modem = &modem_;
  run_ = std::make_unique<MissionRun>(std::move(setup), *output_);
}

void MapperRun::planMemory() {
  const MapCore& map = run_->system().map();
  budget_.addFixed("map: quadtree and meshes' poses", map.movingMap().memoryBytes());
  if (const LocalisationCore* localisation = map.localisation()) {
    budget_.addFixed("pose graph", localisation->graph().memoryBytes());
    budget_.addFixed("keyframes and closures",
                     localisation->memoryBytes() - localisation->graph().memoryBytes());
  }
  budget_.addFixed("link", run_->system().link().memoryBytes());
  budget_.add("saved state", checkpoints_->capacity(), [this] {
    const CheckpointWriter::Counters c = checkpoints_->counters();
    return rt::PoolUse{static_cast<std::size_t>(c.bytes), static_cast<std::size_t>(c.bytes), c.too_large};
  });
  // Further memory that lives as long as the program: images in stereo, lighting and features,
  // rows. Memory that is free again is part of the heap's reserve.
  const std::size_t heap_free = rt::HeapReserve::heapBytes() - rt::HeapReserve::usedBytes();
  const std::size_t planned = budget_.plannedBytes() + heap_free;
  const std::size_t mapped = rt::mappedPrivateBytes();
  if (mapped > planned) budget_.addFixed("images in work", mapped - planned);
  // To come.
  budget_.addFixed("stacks", 2 * setup_.config.live.realtime.stack_bytes);
  budget_.addFixed("heap of libraries", setup_.config.live.memory.heap_bytes);
  // The vehicle's plan has the program and its libraries, but for what each process writes there.
  budget_.addFixed("program's own data", rt::privateFileBytes());
}

void MapperRun::measure(const rt::HeapReserve& heap) {
  heap_ = &heap;
  rt::ProcessFigures process;
  if (process_.read(process)) faults_at_arming_ = process.minor_faults;
  resident_at_arming_ = rt::exactResidentBytes();
  reportMemory();
}

void MapperRun::reportMemory() {
  MapperFigures figures;
  addMemory(figures);
  channel_.up().figures.write(figures);
}

void MapperRun::addMemory(MapperFigures& figures) {
  rt::ProcessFigures process;
  figures.planned = budget_.plannedBytes();
  figures.resident_at_arming = resident_at_arming_;
  if (heap_ != nullptr) figures.heap_overflow = heap_->overflowBytes();
  if (!process_.read(process)) return;
  figures.resident = process.resident;
  figures.own = process.resident_private;
  figures.minor_faults = process.minor_faults - faults_at_arming_;
}

bool MapperRun::load(const CheckpointHead& head) {
  std::vector<std::string> said;
  const auto state = files_.read(head.number, checkpoints_->begin(), said);
  for (const std::string& line : said) say(line);
  if (!state) return false;
  rt::StateReader reader(*state);
  if (!run_->rollBackSlots(head.number))
    say(files_.file(head.number).string() + ": cannot be used (what the slots held then is not known)");
  else if (!run_->load(reader))
    say(files_.file(head.number).string() + ": cannot be used (" + reader.failure() + ")");
  else if (!run_->slotsHold())
    say(files_.file(head.number).string() + ": cannot be used (a power loss left slots of another time)");
  else
    return true;
  return false;
}

void MapperRun::begin() {
  MapperUp& up = channel_.up();
  const MapperDown& down = std::as_const(channel_).down();
  up.enter(MapperPhase::kLoading);
  std::uint64_t number = 0;
  bool loaded = false, tried = false;
  for (const CheckpointHead& head : heads_) {
    const std::string file = files_.file(head.number).string();
    if (std::any_of(down.avoid.begin(), down.avoid.end(), [&](const auto& n) { return n == head.number; })) {
      say(file + ": passed over, the program has died of it");
      continue;
    }
    up.loading.store(head.number);
    if (!feed_.begin(head.number, head.inputs)) {
      say(file + ": passed over, the log does not reach to its mark");
      continue;
    }
    if (tried) make(true);
    tried = true;
    loaded = load(head);
    number = head.number;
    if (loaded) break;
  }
  up.loading.store(0);
  if (!loaded) {
    if (!heads_.empty()) {
      say("no saved state can be used; all is done again from the log");
      make(false);
    }
    (void)feed_.begin(0, 0);
    number = down.from_empty.load() ? io::Mark::kEmptyMap : 0;
    run_->system().setMapping(!down.from_empty.load());
  }
  tier_ = std::make_unique<MapperTier>(
      *run_,
      MapperTier::Links{&feed_, &frames_, &channel_, &modem_, checkpoints_.get(), down.configuration,
                        down.mission,
                        [this](const std::string& name, CameraSide side) { return hasPixels(name, side); },
                        [this](MapperFigures& figures) { addMemory(figures); }, [this] { return lossy(); }},
      MapperTier::Config{setup_.config.live.overload,
                         static_cast<std::int64_t>(1e9 / setup_.mission.cameras.rate_hz),
                         static_cast<std::int64_t>(setup_.config.live.checkpoint_s * 1e9)},
      clock_);
  if (down.fresh.load()) {
    up.enter(MapperPhase::kRunning);
  } else {
    tier_->awaitMark(number, down.inputs.next());
    up.enter(MapperPhase::kCatchingUp);
  }
  up.position.store(feed_.position());
  tier_->publish();
  up.begun_with.store(number + 1);
}

void MapperRun::follow() {
  std::int64_t next_look = 0;
  while (!tier_->ended()) {
    if (tier_->work(kInputsAtOnce) == 0) rt::restFor(rt::kPollRest_ns);
    if (!lossy() || clock_.monotonicNs() < next_look) continue;
    next_look = clock_.monotonicNs() + kDiskLookNs;
    if (slots_refused_ && takesFiles(slot_paths_.front().parent_path()))
      throw std::runtime_error(
          "the disk had refused meshes or features and takes them again; the map is rebuilt");
    // The map continues without rows as long as the disk refuses; they are made again from an earlier state.
    if (output_->lost() && output_->diskTakesData())
      throw std::runtime_error("the disk had refused rows of the output and takes them again (" +
                               output_->failure() + "); they are made again");
  }
}

bool MapperRun::finish() {
  if (slots_refused_ && takesFiles(slot_paths_.front().parent_path()))
    throw std::runtime_error("the disk had refused meshes or features; they are made again before the end");
  channel_.up().enter(MapperPhase::kFinishing);
  run_->finish(0);
  tier_->publish();
  rt::faultPoint("output");
  const bool mapped = run_->write(0, rt::seconds(clock_.monotonicNs() - begun_ns_));
  if (output_->rowsDamaged()) giveUpStates();
  const RunSummary s = run_->summary();
  if (!s.warning.empty()) say("warning: " + s.warning);
  std::printf(
      "%.0f s live: %llu of %llu pairs mapped, %.0f m2; %llu frames, %llu bytes sent, %llu received\n",
      s.mission_s, static_cast<unsigned long long>(s.pairs_used), static_cast<unsigned long long>(s.pairs),
      s.mapped_area, static_cast<unsigned long long>(s.frames),
      static_cast<unsigned long long>(s.frame_bytes), static_cast<unsigned long long>(s.frames_received));
  std::fflush(stdout);
  if (mapped) output_->commit();
  return mapped;
}

// Rows that a state counts on are not what was written: the next mapper makes all again from the log.
void MapperRun::giveUpStates() {
  std::vector<std::string> said;
  const MapperDown& down = std::as_const(channel_).down();
  for (const CheckpointHead& head : files_.usable(down.configuration, down.mission, said)) {
    std::error_code ignored;
    const std::filesystem::path state = files_.file(head.number);
    std::filesystem::rename(state, state.string() + ".unused", ignored);
  }
  throw std::runtime_error("rows of the output are damaged; all is made again from the log");
}

// A state that is ahead of the log would be of no use, and one whose decisions the log lacks would not be
// what a replay makes of it.
void MapperRun::writeCheckpoint() {
  if (!checkpoints_->waiting()) return;
  const MapperDown& down = std::as_const(channel_).down();
  if (checkpoints_->head().inputs > down.safe_position.load() ||
      checkpoints_->decisions() > down.decisions_safe.load())
    return;
  if (!checkpoints_->work()) say("no state can be saved: " + files_.error());
}

std::optional<ImageView> MapperRun::pixels(const std::string& file_name, CameraSide side) {
  const auto held = frames_.find(file_name, side);
  return held ? held : recorded_source_.images(file_name, side);
}

bool MapperRun::hasPixels(const std::string& file_name, CameraSide side) {
  std::error_code error;
  return frames_.has(file_name, side) ||
         std::filesystem::exists(io::MissionPaths(setup_.folder).images() / file_name, error);
}

}  // namespace fathom::onboard
