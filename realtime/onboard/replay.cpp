#include "realtime/onboard/replay.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "realtime/base/units.hpp"
#include "realtime/onboard/map/mesh_slot.hpp"
#include "realtime/onboard/mission_run.hpp"
#include "realtime/onboard/onboard_output.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "realtime/onboard/recorded_pairs.hpp"
#include "realtime/onboard/restarting_run.hpp"
#include "realtime/onboard/slots/slot_file.hpp"
#include "recon/geometry/colour.hpp"

namespace fathom::onboard {
namespace {

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
