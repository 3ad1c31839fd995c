// report_realtime: wake-up latency of the hard tier's loop against cyclictest's, in alternating turns on the
// same machine under the same load.

#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/tiers/arming.hpp"
#include "realtime/kernel/tiers/cpu_wake_limit.hpp"
#include "tests/bench/realtime/child_process.hpp"
#include "tests/bench/realtime/hard_loop.hpp"
#include "tests/bench/realtime/latency_histogram.hpp"
#include "tests/bench/realtime/latency_svg.hpp"

namespace fathom::bench {
namespace {

constexpr std::int64_t kNsPerSecond = 1'000'000'000;
constexpr std::size_t kMib = std::size_t{1} << 20;
// Both end by themselves when the report is gone.
const char* const kHog = "while kill -0 $PPID; do i=0; while [ $i -lt 100000 ]; do i=$((i+1)); done; done";
const char* const kOverAndOver = "while kill -0 $PPID; do ";

struct Options {
  int turns = 15;
  int turn_seconds = 60;
  int priority = 80;
  int cpu = -1;
  int hogs = 1;
  int cpu_wake_us = rt::RealtimeConfig{}.cpu_wake_us;
  bool soft = false;
  std::string load;
  std::string output = "report_realtime";
};

LatencyHistogram runCyclictest(const Options& options, const std::string& file) {
  std::vector<std::string> arguments{"cyclictest",
                                     "--quiet",
                                     "--mlockall",
                                     "-t1",
                                     "-p" + std::to_string(options.priority),
                                     "-i" + std::to_string(rt::RealtimeConfig{}.period_ns / 1000),
                                     "-h" + std::to_string(LatencyHistogram::kMicroseconds),
                                     "-D" + std::to_string(options.turn_seconds) + "s"};
  if (options.cpu >= 0) arguments.push_back("-a" + std::to_string(options.cpu));
  ChildProcess cyclictest(arguments, file);
  if (cyclictest.wait() != 0) throw std::runtime_error("cyclictest failed; install rt-tests and run as root");
  std::ifstream stream(file);
  const std::string printed{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  const auto histogram = readCyclictest(printed);
  if (!histogram) throw std::runtime_error("cyclictest printed no whole histogram: " + file);
  return *histogram;
}

nlohmann::json asJson(const LatencySeries& series) {
  LatencyHistogram all;
  nlohmann::json minutes = nlohmann::json::array();
  for (const LatencyHistogram& minute : series.minutes) {
    all.merge(minute);
    minutes.push_back({{"wakeups", minute.count()},
                       {"p50_us", minute.percentile(50)},
                       {"p99_us", minute.percentile(99)},
                       {"p999_us", minute.percentile(99.9)},
                       {"max_us", minute.max()}});
  }
  nlohmann::json json{{"wakeups", all.count()}, {"max_us", all.max()}, {"turns", minutes}};
  for (const auto& [key, percent] : {std::pair{"p50_us", 50.0}, {"p99_us", 99.0}, {"p999_us", 99.9}}) {
    const Interval interval = percentileInterval(series.minutes, percent);
    json[key] = {{"value", interval.value}, {"low", interval.low}, {"high", interval.high}};
  }
  return json;
}

void print(const char* name, const nlohmann::json& j) {
  std::printf("%-12s %9llu wake-ups  ", name, j["wakeups"].get<unsigned long long>());
  for (const char* key : {"p50_us", "p99_us", "p999_us"})
    std::printf("%s %g (%g to %g)  ", key, j[key]["value"].get<double>(), j[key]["low"].get<double>(),
                j[key]["high"].get<double>());
  std::printf("max_us %lld\n", j["max_us"].get<long long>());
}

std::string machine() {
  utsname name{};
  ::uname(&name);
  return std::string(name.sysname) + " " + name.release + " " + name.version + ", " +
         std::to_string(::sysconf(_SC_NPROCESSORS_ONLN)) + " CPUs";
}

int report(const Options& options) {
  rt::HeapReserve::takeOverAllocator();
  std::filesystem::create_directories(options.output);
  const auto inOutput = [&](const char* name) {
    return (std::filesystem::path(options.output) / name).string();
  };

  rt::RealtimeConfig config;
  config.soft = options.soft;
  config.hard_priority = options.priority;
  config.cpu_wake_us = options.cpu_wake_us;
  if (options.cpu >= 0) config.hard_cpus = {options.cpu};
  const rt::CpuWakeLimit wake(config.cpu_wake_us);
  HardLoop loop(config);
  rt::MemoryBudget budget(256 * kMib);
  rt::HeapReserve heap;
  const rt::ArmingResult armed = rt::arm(config, budget, heap, 16 * kMib);
  std::fputs(armed.table().c_str(), stdout);
  if (!armed.complete()) std::fputs(armed.message().c_str(), stderr);
  if (!armed.armed()) return kExitFailedWork;

  std::vector<std::unique_ptr<ChildProcess>> load;
  for (int i = 0; i < options.hogs; ++i)
    load.push_back(std::make_unique<ChildProcess>(std::vector<std::string>{"/bin/sh", "-c", kHog}, ""));
  if (!options.load.empty())
    load.push_back(std::make_unique<ChildProcess>(
        std::vector<std::string>{"/bin/sh", "-c", kOverAndOver + options.load + " || sleep 1; done"},
        inOutput("load.log")));

  LatencySeries ours{"fathom's loop", {}}, theirs{"cyclictest", {}};
  rt::ThreadCost cost;
  std::uint64_t slipped = 0, samples = 0;
  std::int64_t max_body_ns = 0;
  for (int turn = 0; turn < options.turns; ++turn) {
    const HardLoop::Result result = loop.run(options.turn_seconds * kNsPerSecond);
    ours.minutes.push_back(result.latency);
    cost.heap_calls += result.cost.heap_calls;
    cost.minor_faults += result.cost.minor_faults;
    cost.major_faults += result.cost.major_faults;
    slipped += result.slipped;
    samples += result.samples;
    max_body_ns = std::max(max_body_ns, result.max_body_ns);
    theirs.minutes.push_back(runCyclictest(options, inOutput("cyclictest.txt")));
    std::printf("turn %2d: p99.9 %lld us, max %lld us; cyclictest p99.9 %lld us, max %lld us\n", turn + 1,
                static_cast<long long>(ours.minutes.back().percentile(99.9)),
                static_cast<long long>(ours.minutes.back().max()),
                static_cast<long long>(theirs.minutes.back().percentile(99.9)),
                static_cast<long long>(theirs.minutes.back().max()));
    std::fflush(stdout);
  }

  const Interval ratio = ratioInterval(ours.minutes, theirs.minutes, 99.9);
  nlohmann::json json{{"machine", machine()},
                      {"priority", options.priority},
                      {"turns", options.turns},
                      {"turn_seconds", options.turn_seconds},
                      {"hogs", options.hogs},
                      {"load", options.load},
                      {"cpu", options.cpu},
                      {"cpu_wake_us", options.cpu_wake_us},
                      {"cpu_wake_held", wake.held()},
                      {"soft", !armed.complete()},
                      {"loop", asJson(ours)},
                      {"cyclictest", asJson(theirs)},
                      {"p999_ratio", {{"value", ratio.value}, {"low", ratio.low}, {"high", ratio.high}}},
                      {"loop_heap_calls", cost.heap_calls},
                      {"loop_minor_faults", cost.minor_faults},
                      {"loop_major_faults", cost.major_faults},
                      {"loop_slipped_cycles", slipped},
                      {"loop_samples", samples},
                      {"loop_max_body_us", static_cast<double>(max_body_ns) / 1000}};
  print("loop", json["loop"]);
  print("cyclictest", json["cyclictest"]);
  std::printf("ratio of p99.9: %.2f (95 %%: %.2f to %.2f)\n", ratio.value, ratio.low, ratio.high);
  std::printf("the loop after arming: %llu heap calls, %llu minor and %llu major page faults, %llu slipped\n",
              static_cast<unsigned long long>(cost.heap_calls),
              static_cast<unsigned long long>(cost.minor_faults),
              static_cast<unsigned long long>(cost.major_faults), static_cast<unsigned long long>(slipped));
  std::ofstream(inOutput("realtime.json")) << json.dump(1) << '\n';
  std::ofstream(inOutput("realtime.svg")) << latencySvg(
      "Wake-up latency at 100 Hz, SCHED_FIFO " + std::to_string(options.priority) + ", " +
          std::to_string(options.hogs) + " hog" + (options.load.empty() ? "" : ", vision at full rate"),
      ours, theirs);
  return kExitSuccess;
}

}  // namespace
}  // namespace fathom::bench

int main(int argc, char** argv) {
  using namespace fathom;
  bench::Options options;
  CLI::App app("Wake-up latency of the hard tier's 100 Hz loop against cyclictest's, turn by turn");
  app.add_option("--minutes", options.turns, "Turns of each")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--turn-seconds", options.turn_seconds, "Length of a turn [s]")
      ->check(CLI::Range(1, 3600))
      ->capture_default_str();
  app.add_option("--priority", options.priority, "SCHED_FIFO priority of both")
      ->check(CLI::Range(1, 98))
      ->capture_default_str();
  app.add_option("--cpu", options.cpu, "CPU of both; -1: any")
      ->check(CLI::Range(-1, 1023))
      ->capture_default_str();
  app.add_option("--hogs", options.hogs, "Shells that do nothing but run")
      ->check(CLI::Range(0, 64))
      ->capture_default_str();
  app.add_option("--load-command", options.load, "Run beside, over and over");
  app.add_option("--cpu-wake-us", options.cpu_wake_us,
                 "Limit on the CPUs' wake-up while the loop's program runs")
      ->capture_default_str();
  app.add_flag("--soft", options.soft, "Go on without privileges");
  app.add_option("--output", options.output, "Folder for realtime.json and realtime.svg")
      ->capture_default_str();
  if (const auto code = parseCommandLine("report_realtime", app, argc, argv)) return *code;
  return runTool("report_realtime", [&] { return bench::report(options); });
}
