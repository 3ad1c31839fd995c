// report_endurance: the whole live program over a long mission, faster than real time, and whether its memory
// stays as it was armed: resident set of the process, heap calls and page faults of the hard tier.

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "firmware_if/log/onboard_input.hpp"
#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/memory/process_memory.hpp"
#include "realtime/onboard/onboard_config.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "tests/bench/realtime/shuttle_devices.hpp"

namespace fathom::bench {
namespace {

constexpr double kKib = 1024.0;
constexpr std::int64_t kNsPerSecond = 1'000'000'000;

struct Options {
  std::string mission, config, output = "report_endurance";
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

void prepareFolder(const Options& options) {
  std::filesystem::create_directories(options.output);
  for (const char* name : {"mission.toml", "stereo.calib"})
    std::filesystem::copy_file(std::filesystem::path(options.mission) / name,
                               std::filesystem::path(options.output) / name,
                               std::filesystem::copy_options::overwrite_existing);
}

int report(const Options& options) {
  (void)rt::HeapReserve::takeOverAllocator();
  prepareFolder(options);
  const io::MissionConfig mission = io::readMissionConfig(options.output);
  const StereoRig rig = readStereoCalib(io::MissionPaths(options.output).calib());
  onboard::OnboardConfig config = onboard::readOnboardConfig(
      options.config.empty() ? std::nullopt : std::optional<std::filesystem::path>(options.config), mission);
  config.live.realtime.soft = options.soft;
  (void)rt::setLibraryStackBytes(config.live.realtime.library_stack_bytes);

  std::uint64_t damaged = 0;
  const Shuttle shuttle(io::readOnboardInputs(options.mission, damaged), options.pairs);
  if (shuttle.stepsOfLeg() == 0 || shuttle.images(CameraSide::kLeft).empty())
    throw InputError(options.mission, "", "holds no stereo pairs");
  rt::VehicleClock clock(rt::VehicleClock::systemOffsetNs(), options.rate);
  constexpr std::int64_t kSetUpNs = 20 * kNsPerSecond;  // of the machine's time, before the first sample
  const std::int64_t begin =
      clock.utcNs() + static_cast<std::int64_t>(static_cast<double>(kSetUpNs) * options.rate);
  std::atomic<std::uint64_t> given{0};
  onboard::LiveSystem live({options.output, config, mission, rig},
                           shuttleDevices(shuttle, io::MissionPaths(options.mission).images(), options.output,
                                          mission, rig, clock, begin, options.frames, given),
                           clock);
  rt::HeapReserve heap;
  const rt::ArmingResult armed = live.arm(heap);
  std::fputs(live.budget().table(false).c_str(), stdout);
  std::fputs(armed.complete() ? armed.table().c_str() : armed.message().c_str(), stdout);
  if (!armed.armed()) return kExitFailedWork;

  const Memory first = memoryNow();
  nlohmann::json samples = nlohmann::json::array();
  std::uint64_t next_sample = 0;
  std::size_t highest = first.resident;
  while (given.load(std::memory_order_relaxed) < options.frames) {
    for (const std::string& event : live.supervise()) std::printf("%s\n", event.c_str());
    const std::uint64_t now = given.load(std::memory_order_relaxed);
    if (now >= next_sample) {
      const Memory memory = memoryNow();
      highest = std::max(highest, memory.resident);
      std::printf(
          "%6llu pairs: resident %.0f KiB, %+.0f KiB since arming (own %.0f, files %.0f); heap overflow %zu "
          "B\n",
          static_cast<unsigned long long>(now), static_cast<double>(memory.resident) / kKib,
          (static_cast<double>(memory.resident) - static_cast<double>(first.resident)) / kKib,
          static_cast<double>(memory.anonymous) / kKib, static_cast<double>(memory.files) / kKib,
          heap.overflowBytes());
      std::fflush(stdout);
      samples.push_back({{"pairs", now}, {"resident", memory.resident}});
      next_sample = now + std::max<std::uint64_t>(options.frames / 36, 1);
    }
    constexpr std::int64_t kLookNs = kNsPerSecond / 5;
    clock.sleepUntil(clock.monotonicNs() +
                     static_cast<std::int64_t>(static_cast<double>(kLookNs) * options.rate));
  }
  const Memory last = memoryNow();
  const rt::ThreadCost cost = live.hardCost();
  live.stop();
  const onboard::RunSummary summary = live.run().summary();
  const double growth = static_cast<double>(last.resident) - static_cast<double>(first.resident);
  std::printf(
      "%llu pairs given, %llu mapped; resident set %.1f MiB at arming, growth %.0f KiB, highest %.1f MiB; "
      "hard tier: %llu heap calls, %llu minor and %llu major faults\n",
      static_cast<unsigned long long>(given.load()), static_cast<unsigned long long>(summary.pairs_used),
      static_cast<double>(first.resident) / kKib / kKib, growth / kKib,
      static_cast<double>(highest) / kKib / kKib, static_cast<unsigned long long>(cost.heap_calls),
      static_cast<unsigned long long>(cost.minor_faults), static_cast<unsigned long long>(cost.major_faults));
  std::fputs(live.budget().table(true).c_str(), stdout);
  const nlohmann::json json{{"pairs", given.load()},
                            {"pairs_mapped", summary.pairs_used},
                            {"rate", options.rate},
                            {"soft", !armed.complete()},
                            {"resident_at_arming", first.resident},
                            {"resident_at_end", last.resident},
                            {"resident_highest", highest},
                            {"growth_bytes", growth},
                            {"heap_overflow_bytes", heap.overflowBytes()},
                            {"hard_heap_calls", cost.heap_calls},
                            {"hard_minor_faults", cost.minor_faults},
                            {"hard_major_faults", cost.major_faults},
                            {"samples", samples}};
  std::ofstream(std::filesystem::path(options.output) / "endurance.json") << json.dump(1) << '\n';
  return kExitSuccess;
}

}  // namespace
}  // namespace fathom::bench

int main(int argc, char** argv) {
  using namespace fathom;
  bench::Options options;
  CLI::App app("The live program over a long mission made of a short one, flown forward and back");
  app.add_option("mission", options.mission, "Mission folder with images")->required();
  app.add_option("--config", options.config, "onboard.toml");
  app.add_option("--frames", options.frames, "Stereo pairs in all")->capture_default_str();
  app.add_option("--pairs", options.pairs, "Stereo pairs of one way")
      ->check(CLI::Range(2, 100000))
      ->capture_default_str();
  app.add_option("--rate", options.rate, "Times as fast as the mission")
      ->check(CLI::Range(0.1, 100.0))
      ->capture_default_str();
  app.add_flag("--soft", options.soft, "Go on without privileges");
  app.add_option("--output", options.output, "Folder for the recording and endurance.json")
      ->capture_default_str();
  if (const auto code = parseCommandLine("report_endurance", app, argc, argv)) return *code;
  return runTool("report_endurance", [&] { return bench::report(options); });
}
