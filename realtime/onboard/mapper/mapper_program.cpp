#include "realtime/onboard/mapper/mapper_run.hpp"

#include <sys/prctl.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <exception>
#include <string>

#include "realtime/base/input_error.hpp"
#include "realtime/kernel/fault_point.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/threads/arming.hpp"
#include "realtime/kernel/threads/realtime_config.hpp"
#include "realtime/onboard/checkpoint/checkpoint_names.hpp"
#include "recon/geometry/colour.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kCheckpointRest_ns = 100'000'000;

// It lives and dies by its parent alone: what ends the survey comes through the log.
void listenToNobody() {
  ::prctl(PR_SET_NAME, "fathom-mapper");
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() == 1) ::_exit(kExitFailedWork);  // it died before
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) ::signal(signal, SIG_IGN);
}

MapperRun::Setup readSetup(const MapperOptions& options, const MapperDown& down) {
  MapperRun::Setup setup;
  setup.folder = options.folder;
  setup.mission = io::readMissionConfig(options.folder);
  const std::filesystem::path calib = io::MissionPaths(options.folder).calib();
  setup.rig = readStereoCalib(calib);
  setup.config = readOnboardConfig(options.config, setup.mission);
  setup.config.colours = readColours(calib);
  if (options.soft) setup.config.live.realtime.soft = true;
  setup.plan_only = options.print_budget;
  const CheckpointNames names = checkpointNames(options.folder, setup.config, setup.mission);
  if (names.configuration != down.configuration || names.mission != down.mission)
    throw InputError(options.folder, "mission.toml, stereo.calib or the configuration",
                     "was changed during the dive; put it back as it was, and the map continues");
  return setup;
}

// A state that fails is one state less.
void saveWhatWaits(MapperRun& run) {
  try {
    rt::faultPoint("checkpoints");
    run.writeCheckpoint();
  } catch (const std::exception& e) {
    std::fprintf(stderr, "fathom-onboard: no state was saved (%s)\n", e.what());
  }
}

int map(const MapperOptions& options, MapperChannel& channel) {
  const MapperDown& down = std::as_const(channel).down();
  MapperUp& up = channel.up();
  rt::VehicleClock clock(down.clock);
  MapperRun run(readSetup(options, down), channel, clock);
  if (options.print_budget) {
    std::fprintf(stderr, "mapper process\n%s", run.budget().table(false).c_str());
    run.reportMemory();
    return kExitSuccess;
  }
  const LiveConfig& live = run.config().live;
  (void)rt::setLibraryStackBytes(live.realtime.library_stack_bytes);
  rt::HeapReserve heap;
  // All of it locked and there before the first input is read: it shall not be refused later.
  const rt::ArmingResult arming = rt::arm(live.realtime, run.budget(), heap, live.memory.heap_bytes);
  if (down.fresh.load() && !arming.complete())
    std::fprintf(stderr, "fathom-onboard: the mapper is without %s\n", arming.missingNames().c_str());
  run.measure(heap);
  run.begin();

  std::atomic<bool> stop{false}, mapped{false}, failed{false};
  std::string why;
  rt::RtThread vision(rt::threadConfig(live.realtime, rt::Tier::kSoft, "vision"));
  rt::RtThread saving(rt::threadConfig(live.realtime, rt::Tier::kBestEffort, "checkpoints"));
  (void)saving.start([&] {
    while (!stop.load(std::memory_order_acquire)) {
      saveWhatWaits(run);
      rt::restFor(kCheckpointRest_ns);
    }
  });
  const bool started = vision.start([&] {
    try {
      run.follow();
      mapped = run.finish();
    } catch (const std::exception& e) {
      why = e.what();
      failed = true;
    }
  });
  if (!started) throw std::runtime_error("no thread for vision");
  vision.join();
  stop.store(true, std::memory_order_release);
  // From here on nothing is waited for long: the vehicle kills a process whose map is written.
  if (!failed) up.enter(mapped ? MapperPhase::kEnded : MapperPhase::kNoMap);
  saving.join();
  if (failed) throw std::runtime_error(why);
  return mapped ? kExitSuccess : kExitFailedWork;
}

}  // namespace

int runMapper(const MapperOptions& options) {
  listenToNobody();
  MapperChannel channel(kMapperDownFile, kMapperUpFile);
  channel.up().enter(MapperPhase::kStarting);
  try {
    return map(options, channel);
  } catch (const InputError&) {
    channel.up().enter(MapperPhase::kRefused);
    throw;
  }
}

}  // namespace fathom::onboard
