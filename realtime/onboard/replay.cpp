#include "realtime/onboard/replay.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <stdexcept>
#include <utility>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "realtime/base/units.hpp"
#include "realtime/onboard/map/moving_map.hpp"
#include "realtime/onboard/onboard_output.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "realtime/onboard/recorded_pairs.hpp"
#include "realtime/onboard/slots/slot_file.hpp"
#include "recon/geometry/colour.hpp"

namespace fathom::onboard {
namespace {

const io::Mark* markOf(const io::OnboardInput& input, io::Mark::Kind kind) {
  const auto* mark = std::get_if<io::Mark>(&input.what);
  return mark != nullptr && mark->kind == kind ? mark : nullptr;
}

using Clock = std::chrono::steady_clock;
using rt::secondsSince;

// Recorded by this program on the vehicle: time itself is among the inputs.
bool recordedLive(const std::vector<io::OnboardInput>& inputs) {
  return std::any_of(inputs.begin(), inputs.end(),
                     [](const io::OnboardInput& i) { return std::holds_alternative<io::Tick>(i.what); });
}

// Pools for the mission at hand: its exposures bound the pairs, and these the keyframes. A live run had the
// pools of its configuration, so its replay has them too; the slots on the disk need only be as many as will
// be used.
struct SlotCounts {
  int pairs = 0, keyframes = 0;
};
SlotCounts fitToMission(OnboardConfig& config, const std::vector<io::OnboardInput>& inputs) {
  int exposures = 0;
  for (const io::OnboardInput& input : inputs)
    if (const ImageEvent* image = io::imageOf(input)) exposures += image->side == CameraSide::kLeft;
  const SlotCounts counts = {std::clamp(exposures, 1, config.max_pairs),
                             std::clamp(exposures, 2, config.localisation.max_keyframes)};
  if (recordedLive(inputs)) return counts;
  config.max_pairs = counts.pairs;
  config.localisation.max_keyframes = counts.keyframes;
  return counts;
}

struct Slots {
  std::unique_ptr<SlotFile> features, meshes;
};

Slots makeSlots(const OnboardConfig& config, const SlotCounts& counts, const std::filesystem::path& beside) {
  if (!config.localisation.enabled) return {};
  const std::filesystem::path folder = config.slot_folder.empty() ? beside : config.slot_folder;
  const auto slot_bytes = closure::slotBytes(static_cast<std::size_t>(config.localisation.features));
  return {std::make_unique<SlotFile>(folder, static_cast<std::size_t>(counts.keyframes), slot_bytes),
          std::make_unique<SlotFile>(folder, static_cast<std::size_t>(counts.pairs),
                                     meshSlotBytes(static_cast<std::size_t>(config.stereo.max_features)))};
}

// What was decided about pairs when the mission was live, by pair.
std::map<std::uint32_t, OnboardSystem::PairQuota> decisionsOf(const std::vector<io::OnboardInput>& inputs) {
  std::map<std::uint32_t, OnboardSystem::PairQuota> decisions;
  for (const io::OnboardInput& input : inputs)
    if (const auto* d = std::get_if<io::Decision>(&input.what)) decisions[d->pair_index] = pairQuota(*d);
  return decisions;
}

}  // namespace

RestartingRun::RestartingRun(Make make, const std::vector<io::OnboardInput>& inputs)
    : make_(std::move(make)), inputs_(inputs), run_(make_()) {
  for (std::size_t i = 0; i < inputs_.size(); ++i)
    if (const io::Mark* mark = markOf(inputs_[i], io::Mark::Kind::kRestart))
      if (mark->number != io::Mark::kEmptyMap) saved_[mark->number].last_use = i;
  if (saved_.count(0) > 0) save(saved_[0], 0);
}

void RestartingRun::save(Saved& to, std::size_t next) {
  to.next = next;
  constexpr std::size_t kFirst = std::size_t{16} << 20;
  to.state.resize(kFirst);
  for (;;) {
    rt::StateWriter writer(to.state);
    run_->save(writer);
    if (!writer.full()) {
      to.state.resize(writer.size());
      to.state.shrink_to_fit();
      return;
    }
    to.state.resize(writer.needed() + writer.needed() / 4);
  }
}

// A state may have been saved while the mapper did again what it had done before.
void RestartingRun::consume(std::size_t i) {
  run_->consume(inputs_[i]);
  const io::Mark* mark = markOf(inputs_[i], io::Mark::Kind::kCheckpoint);
  if (mark == nullptr) return;
  if (const auto wanted = saved_.find(mark->number); wanted != saved_.end()) save(wanted->second, i + 1);
}

void RestartingRun::restartEmpty() {
  run_ = make_();
  (void)run_->rollBackSlots(0);
  run_->system().setMapping(false);
  for (std::size_t i = 0; i < next_; ++i) consume(i);
  run_->system().setMapping(true);
}

void RestartingRun::restart(std::uint64_t number) {
  if (number == io::Mark::kEmptyMap) return restartEmpty();
  const auto from = saved_.find(number);
  if (from == saved_.end() || from->second.state.empty())
    throw std::runtime_error("the log restarts from checkpoint " + std::to_string(number) +
                             ", whose mark it does not hold");
  run_ = make_();
  rt::StateReader reader(from->second.state);
  if (!run_->rollBackSlots(number))
    throw std::runtime_error("the slots cannot go back to checkpoint " + std::to_string(number) +
                             " (disk full?); give slam.slot_folder on another disk");
  if (!run_->load(reader))
    throw std::runtime_error(std::string("a kept state does not load: ") + reader.failure());
  for (std::size_t i = from->second.next; i < next_; ++i) consume(i);
  if (from->second.last_use == next_) saved_.erase(from);
  forgetSlots();
}

void RestartingRun::forgetSlots() {
  const auto first = saved_.upper_bound(0);  // going back to 0 takes no memory
  run_->forgetSlots(first == saved_.end() ? UINT64_MAX : first->first);
}

bool RestartingRun::step() {
  if (next_ == inputs_.size()) return false;
  const io::OnboardInput& input = inputs_[next_];
  if (const io::Mark* mark = markOf(input, io::Mark::Kind::kRestart)) restart(mark->number);
  consume(next_++);
  if (markOf(input, io::Mark::Kind::kCheckpoint) != nullptr) forgetSlots();
  return true;
}

ReplaySummary replay(const ReplayOptions& options) {
  const io::MissionPaths paths(options.mission);
  const io::MissionConfig mission = io::readMissionConfig(options.mission);
  OnboardConfig config = readOnboardConfig(options.config, mission);
  if (!config.warning.empty()) std::fprintf(stderr, "fathom-onboard: warning: %s\n", config.warning.c_str());
  if (options.no_slam) config.localisation.enabled = false;
  const StereoRig rig = readStereoCalib(paths.calib());
  config.colours = readColours(paths.calib());

  std::uint64_t damaged = 0;
  const std::vector<io::OnboardInput> inputs = io::readOnboardInputs(options.mission, damaged);
  const std::int64_t first_ns = inputs.front().arrival_utc_ns;

  const auto start = Clock::now();
  RecordedPairs pairs(paths, mission, rig);
  OnboardOutput output(options.out.value_or(paths.onboard()), mission.origin);
  const SlotCounts counts = fitToMission(config, inputs);
  const Slots slots = makeSlots(config, counts, output.folder());
  const auto decisions = decisionsOf(inputs);
  RestartingRun replayed(
      [&] {
        auto run = std::make_unique<MissionRun>(MissionRun::Setup{config,
                                                                  mission,
                                                                  rig,
                                                                  pairs.source(),
                                                                  {slots.features.get(), slots.meshes.get()},
                                                                  options.link,
                                                                  [&] { return pairs.seconds(); }},
                                                output);
        run->system().setPairPolicy([&](const StereoTrigger& trigger, const OnboardSystem::MappedPair&) {
          const auto found = decisions.find(trigger.pair_index);
          return found == decisions.end() ? OnboardSystem::PairQuota() : found->second;
        });
        return run;
      },
      inputs);
  rt::ProgressBar bar;
  const std::int64_t length_ns = std::max<std::int64_t>(inputs.back().arrival_utc_ns - first_ns, 1);
  while (replayed.step()) {
    const RunSummary so_far = replayed.run().summary();
    bar.show(static_cast<double>(replayed.run().nowNs() - first_ns) / static_cast<double>(length_ns),
             "replay: " + std::to_string(so_far.pairs) + " pairs mapped, " + std::to_string(so_far.frames) +
                 " frames sent");
  }
  MissionRun& run = replayed.run();
  // A live run sent what it sent; only where none is known the replay makes up its end.
  run.finish(run.ended() ? 0 : options.drain_s);

  ReplaySummary summary;
  if (!run.write(damaged, secondsSince(start)))
    throw InputError(
        options.mission.string(), "img/",
        "no stereo pair gave a map; see onboard counters: " + std::to_string(run.summary().pairs) +
            " pairs, " + std::to_string(run.system().unreadableImages()) + " unreadable images" +
            (pairs.firstRefusal().empty() ? "" : "; the first: " + pairs.firstRefusal()));
  output.commit();
  static_cast<RunSummary&>(summary) = run.summary();
  summary.damaged_entries = damaged;
  summary.wall_s = secondsSince(start);
  return summary;
}

std::string describe(const ReplaySummary& s) {
  char line[256];
  std::snprintf(line, sizeof line,
                "%.0f s of mission in %.1f s: %llu of %llu pairs mapped (%llu unreadable images), %.0f m2, "
                "%.0f ms a pair; %llu frames, %llu bytes",
                s.mission_s, s.wall_s, static_cast<unsigned long long>(s.pairs_used),
                static_cast<unsigned long long>(s.pairs),
                static_cast<unsigned long long>(s.unreadable_images), s.mapped_area,
                s.pairs ? 1e3 * s.stereo_and_map_s / static_cast<double>(s.pairs) : 0.0,
                static_cast<unsigned long long>(s.frames), static_cast<unsigned long long>(s.frame_bytes));
  return line;
}

}  // namespace fathom::onboard
