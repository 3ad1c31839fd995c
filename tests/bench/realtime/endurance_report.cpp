// The whole live program over a long mission, faster than real time, and whether its memory stays as it was
// armed: resident set of the process, heap calls and page faults of the hard tier.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <optional>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"
#include "realtime/onboard/onboard_config.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/reports.hpp"
#include "tests/onboard/live/played_devices.hpp"

namespace fathom::bench {
namespace {

constexpr double kKib = 1024.0;

struct EnduranceOptions {
  std::filesystem::path mission, config, out = "endurance";
  std::uint64_t frames = 36'000;
  std::size_t pairs = 300;
  double rate = 4;
  bool soft = false;
};

struct Memory {
  std::size_t resident = 0, anonymous = 0, files = 0;  // [bytes]
};

Memory memoryNow() {
  rt::ProcessMemory process;
  rt::ProcessFigures figures;
  (void)process.read(figures);
  return {rt::exactResidentBytes(), figures.resident_private, figures.resident_files};
}

struct Samples {
  Table table;
  std::size_t highest = 0;  // resident [bytes]
};

// Samples the memory 36 times while the mission is played.
Samples sampleMemory(onboard::LiveSystem& live, rt::VehicleClock& clock, const EnduranceOptions& options,
                     const std::atomic<std::uint64_t>& given, const Memory& first) {
  Table samples{
      "Resident set",
      {{"pairs", 0}, {"KiB", 0}, {"since arming", 0}, {"own", 0}, {"files", 0}, {"heap overflow [B]", 0}},
      {}};
  std::uint64_t next_sample = 0;
  std::size_t highest = first.resident;
  while (given.load(std::memory_order_relaxed) < options.frames) {
    for (const std::string& event : live.supervise()) std::printf("%s\n", event.c_str());
    const std::uint64_t now = given.load(std::memory_order_relaxed);
    if (now >= next_sample) {
      const Memory memory = memoryNow();
      highest = std::max(highest, memory.resident);
      samples.rows.push_back(
          {cell(now), static_cast<double>(memory.resident) / kKib,
           (static_cast<double>(memory.resident) - static_cast<double>(first.resident)) / kKib,
           static_cast<double>(memory.anonymous) / kKib, static_cast<double>(memory.files) / kKib,
           cell(live.heap().overflowBytes())});
      std::printf("%6llu pairs: resident %+.0f KiB since arming\n", static_cast<unsigned long long>(now),
                  std::get<double>(samples.rows.back()[2]));
      std::fflush(stdout);
      next_sample = now + std::max<std::uint64_t>(options.frames / 36, 1);
    }
    constexpr std::int64_t kLookNs = kSecond_ns / 5;
    clock.sleepUntil(clock.monotonicNs() +
                     static_cast<std::int64_t>(static_cast<double>(kLookNs) * options.rate));
  }
  return {std::move(samples), highest};
}

int reportEndurance(const EnduranceOptions& options) {
  (void)rt::HeapReserve::takeOverAllocator();
  std::filesystem::create_directories(options.out);
  for (const char* name : {"mission.toml", "stereo.calib"})
    std::filesystem::copy_file(options.mission / name, options.out / name,
                               std::filesystem::copy_options::overwrite_existing);
  const io::MissionConfig mission = io::readMissionConfig(options.out);
  const StereoRig rig = readStereoCalib(io::MissionPaths(options.out).calib());
  onboard::OnboardConfig config = onboard::readOnboardConfig(
      options.config.empty() ? std::nullopt : std::optional(options.config), mission);
  config.live.realtime.soft = options.soft;
  // The libraries of the other reports are resident too; the vehicle's program has none of them.
  config.live.memory.budget_bytes += std::size_t{256} << 20;
  (void)rt::setLibraryStackBytes(config.live.realtime.library_stack_bytes);

  std::uint64_t damaged = 0;
  const test::Shuttle shuttle(io::readOnboardInputs(options.mission, damaged), options.pairs);
  if (shuttle.stepsOfLeg() == 0 || shuttle.images(CameraSide::kLeft).empty())
    throw InputError(options.mission.string(), "", "holds no stereo pairs");
  rt::VehicleClock clock(rt::VehicleClock::systemOffsetNs(), options.rate);
  constexpr std::int64_t kSetUpNs = 20 * kSecond_ns;  // of the machine's time, before the first sample
  const std::int64_t begin =
      clock.utcNs() + static_cast<std::int64_t>(static_cast<double>(kSetUpNs) * options.rate);
  std::atomic<std::uint64_t> given{0};
  const test::PlayedShuttle played(shuttle, begin);
  test::PlayedOptions play{.exposures = options.frames, .given_left = &given, .scratch = options.out};
  onboard::LiveSystem live({options.out, config, mission, rig, test::onboardProgram(),
                            options.config.empty() ? std::nullopt : std::optional(options.config)},
                           test::playedDevices(played, options.mission, mission, rig, clock, play), clock);
  const rt::ArmingResult armed = live.arm();
  std::fputs(live.budget().table(false).c_str(), stdout);
  std::fputs(armed.complete() ? armed.table().c_str() : armed.message().c_str(), stdout);
  if (!armed.armed()) return kExitFailedWork;

  const Memory first = memoryNow();
  Samples samples = sampleMemory(live, clock, options, given, first);
  const Memory last = memoryNow();
  const rt::ThreadCost cost = live.hardCost();
  const onboard::LiveSystem::End end = live.end(config.live.realtime.end_within_s * options.rate);
  for (const std::string& line : end.left_out) std::printf("%s\n", line.c_str());
  onboard::MapState map;
  (void)live.mapper().up().state.read(map);
  const double growth = static_cast<double>(last.resident) - static_cast<double>(first.resident);
  Page page("Endurance of " + options.mission.string());
  page.add(std::move(samples.table));
  page.add({"",
            {{"pairs", 0},
             {"mapped", 0},
             {"times as fast", 1},
             {"soft", 0},
             {"resident at arming [MiB]", 1},
             {"highest [MiB]", 1},
             {"growth [KiB]", 0},
             {"hard tier: heap calls", 0},
             {"minor faults", 0},
             {"major faults", 0}},
            {{cell(given.load()), cell(map.pairs), options.rate, cell(!armed.complete()),
              static_cast<double>(first.resident) / kKib / kKib,
              static_cast<double>(samples.highest) / kKib / kKib, growth / kKib, cell(cost.heap_calls),
              cell(cost.minor_faults), cell(cost.major_faults)}}});
  std::printf("%s%s", page.text().c_str(), live.budget().table(true).c_str());
  page.write(options.out, "endurance");
  return kExitSuccess;
}

}  // namespace

void enduranceReport(CommandLine& program) {
  static EnduranceOptions o;
  CommandLine& command = program.command(
      "endurance", "The live program over a long mission made of a short one, flown forward and back", "",
      [] { return reportEndurance(o); });
  command.add_option("mission", o.mission, "mission folder with images")->required();
  command.add_option("--config", o.config, "onboard.toml");
  command.shown("--frames", o.frames, "stereo pairs in all");
  command.shown("--pairs", o.pairs, "stereo pairs of one pass", 2, 100000);
  command.shown("--rate", o.rate, "times as fast as the mission", 0.1, 100);
  command.add_flag("--soft", o.soft, "continue without privileges");
  command.add_option("--out", o.out, "folder for the recording, endurance.html and endurance.json");
}

}  // namespace fathom::bench
