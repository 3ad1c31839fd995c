// Wake-up latency of the hard tier's loop against cyclictest's, in alternating turns on the same machine
// under the same load.
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/memory/heap_counter.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/threads/arming.hpp"
#include "realtime/kernel/threads/realtime_config.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "realtime/onboard/live/hard_tier.hpp"
#include "realtime/onboard/nav/nav_core.hpp"
#include "sim/hil/bench/child_process.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/reports.hpp"
#include "tests/support/latency_histogram.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::bench {
namespace {

using sim::ChildProcess, test::LatencyHistogram;

constexpr std::int64_t kNsPerUs = 1000;
// Devices keep no step with the loop: their samples come at every phase of its cycle.
constexpr std::int64_t kSamplePeriodNs = 9'700'000;
// Rates of the sensors, as every n-th of some 100 samples a second.
constexpr int kDepthEvery = 10, kDvlEvery = 20, kFrameEvery = 50;

// The hard tier as it runs on the vehicle: a device thread pushes samples of compass, depth, DVL and cameras
// into a ring at their real rates, and the loop drains it into a NavCore.
class HardLoop {
 public:
  struct Result {
    test::LatencyHistogram latency;
    rt::ThreadCost cost;  // of the loop's thread, from its first cycle to its last
    std::uint64_t cycles = 0, late_cycles = 0, samples = 0;
    std::int64_t max_body_ns = 0;
  };

  explicit HardLoop(const rt::RealtimeConfig& config);

  // Runs both threads for some time.
  [[nodiscard]] Result run(std::int64_t duration_ns);

 private:
  void feed();
  void loop(std::int64_t until_ns, Result& result);

  rt::RealtimeConfig config_;
  std::unique_ptr<onboard::NavFeed> nav_;
  onboard::InputRing ring_;
  std::atomic<bool> stop_{false};
  rt::RtThread device_, loop_;
};

HardLoop::HardLoop(const rt::RealtimeConfig& config)
    : config_(config),
      nav_(std::make_unique<onboard::NavFeed>(onboard::NavCoreConfig{})),
      device_(rt::threadConfig(config, rt::Tier::kDevice, "devices")),
      loop_(rt::threadConfig(config, rt::Tier::kHard, "navigation")) {}

void HardLoop::feed() {
  rt::RealClock clock;
  rt::PeriodicLoop periodic(clock, kSamplePeriodNs);
  std::uint32_t n = 0;
  periodic.run([&] {
    const std::int64_t utc = clock.utcNs();
    const auto push = [&](const SensorSample& sample) { (void)ring_.push({utc, sample}); };
    push(AttitudeSample{utc, 0.01, 0.02, 1.0, false});
    if (n % kDepthEvery == 0) push(DepthSample{utc, 20.0});
    if (n % kDvlEvery == 0) {
      DvlSample dvl;
      dvl.utc_ns = utc;
      dvl.velocity = Eigen::Vector3d(0.5, 0, 0);
      dvl.altitude = 2.0;
      push(dvl);
    }
    if (n % kFrameEvery == 0)
      for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight})
        push(ImageEvent{utc, side, {}, 0.002});
    ++n;
    return !stop_.load(std::memory_order_relaxed);
  });
}

void HardLoop::loop(std::int64_t until_ns, Result& result) {
  rt::RealClock clock;
  rt::PeriodicLoop periodic(clock, config_.period_ns);
  const rt::ThreadCost before = rt::threadCost();
  periodic.run([&] {
    const std::int64_t now = clock.monotonicNs();
    result.latency.add((now - periodic.nextDeadlineNs()) / kNsPerUs);
    io::OnboardInput input;
    while (ring_.pop(input)) {
      nav_->add(std::get<SensorSample>(input.what), input.arrival_utc_ns);
      ++result.samples;
    }
    while (nav_->core().pollTrigger()) {
    }
    return now < until_ns;
  });
  result.cost = rt::threadCost() - before;
  result.cycles = periodic.statistics().cycles;
  result.late_cycles = periodic.statistics().skipped_cycles;
  result.max_body_ns = periodic.statistics().max_body_ns;
}

HardLoop::Result HardLoop::run(std::int64_t duration_ns) {
  Result result;
  stop_ = false;
  if (!device_.start([this] { feed(); })) throw std::runtime_error("no thread for the devices");
  const std::int64_t until = rt::RealClock().monotonicNs() + duration_ns;
  if (!loop_.start([&] { loop(until, result); })) throw std::runtime_error("no thread for the loop");
  loop_.join();
  stop_ = true;
  device_.join();
  return result;
}

// Both end by themselves when the report is gone.
const char* const kHog = "while kill -0 $PPID; do i=0; while [ $i -lt 100000 ]; do i=$((i+1)); done; done";
const char* const kOverAndOver = "while kill -0 $PPID; do ";

struct RealtimeOptions {
  int turns = 15;
  int turn_seconds = 60;
  int priority = 80;
  int cpu = -1;
  int hogs = 1;
  int cpu_wake_us = rt::RealtimeConfig{}.cpu_wake_us;
  bool soft = false;
  std::string load;
  std::filesystem::path out = "realtime";
};

struct Series {
  std::string name;
  std::vector<LatencyHistogram> turns;

  [[nodiscard]] LatencyHistogram all() const {
    LatencyHistogram together;
    for (const LatencyHistogram& turn : turns) together.merge(turn);
    return together;
  }
};

LatencyHistogram runCyclictest(const RealtimeOptions& options) {
  const std::filesystem::path file = options.out / "cyclictest.txt";
  std::vector<std::string> arguments{"cyclictest",
                                     "--quiet",
                                     "--mlockall",
                                     "-t1",
                                     "-p" + std::to_string(options.priority),
                                     "-i" + std::to_string(rt::RealtimeConfig{}.period_ns / 1000),
                                     "-h" + std::to_string(LatencyHistogram::kMicroseconds),
                                     "-D" + std::to_string(options.turn_seconds) + "s"};
  if (options.cpu >= 0) arguments.push_back("-a" + std::to_string(options.cpu));
  constexpr double kLate_s = 60;
  ChildProcess cyclictest({arguments, {}, file, std::nullopt});
  if (cyclictest.wait(options.turn_seconds + kLate_s) != 0)
    throw std::runtime_error("cyclictest failed; install rt-tests and run as root");
  const auto histogram = test::readCyclictest(test::readText(file));
  if (!histogram) throw std::runtime_error("cyclictest printed no whole histogram: " + file.string());
  return *histogram;
}

Table percentiles(const std::vector<Series>& both) {
  Table table{"Latency of wake-ups [us], with 95 % intervals", {{"", 0}, {"wake-ups", 0}}, {}};
  for (const char* name : {"p50", "p99", "p99.9"})
    for (const char* what : {"", " from", " to"}) table.columns.push_back({std::string(name) + what, 1});
  table.columns.push_back({"max", 0});
  for (const Series& series : both) {
    table.rows.push_back({series.name, cell(series.all().count())});
    for (const double percent : {50.0, 99.0, 99.9}) {
      const test::Interval p = percentileInterval(series.turns, percent);
      for (const double value : {p.value, p.low, p.high}) table.rows.back().emplace_back(value);
    }
    table.rows.back().push_back(cell(series.all().max()));
  }
  return table;
}

Table turnsTable(const std::vector<Series>& both) {
  Table table{"Turns [us]",
              {{"", 0}, {"turn", 0}, {"wake-ups", 0}, {"p50", 0}, {"p99", 0}, {"p99.9", 0}, {"max", 0}},
              {}};
  for (const Series& series : both)
    for (std::size_t i = 0; i < series.turns.size(); ++i) {
      const LatencyHistogram& turn = series.turns[i];
      table.rows.push_back({series.name, cell(i + 1), cell(turn.count()), cell(turn.percentile(50)),
                            cell(turn.percentile(99)), cell(turn.percentile(99.9)), cell(turn.max())});
    }
  return table;
}

// The share of wake-ups that were later than a time; and each turn's p99.9 (dot) and maximum (bar) in the
// order in which they ran.
void addPlots(const std::vector<Series>& both, web::ReportPage& report) {
  web::Plot shares{.title = "Wake-ups",
                   .x = "wake-up latency [us]",
                   .y = "share of wake-ups later than that",
                   .log_x = true,
                   .log_y = true};
  web::Plot turns{
      .title = "Turn by turn: p99.9 and maximum", .x = "turn", .y = "latency [us]", .log_y = true};
  for (std::size_t s = 0; s < both.size(); ++s) {
    const LatencyHistogram all = both[s].all();
    const auto count = static_cast<double>(all.count());
    web::Series curve{.label = both[s].name,
                      .colour = web::distinctColour(s),
                      .at = {{static_cast<double>(std::max<std::int64_t>(all.percentile(0), 1)), 1}},
                      .size = 2};
    double later = count;
    for (std::size_t us = 0; us < all.counts().size(); ++us) {
      if (all.counts()[us] == 0) continue;
      const double at = static_cast<double>(us) + 1;
      curve.at.emplace_back(at, curve.at.back().y());
      later -= static_cast<double>(all.counts()[us]);
      if (later > 0) curve.at.emplace_back(at, later / count);
    }
    shares.series.push_back(std::move(curve));
    web::Series dots{
        .label = both[s].name, .kind = web::Series::Kind::kDots, .colour = web::distinctColour(s), .size = 4},
        bars{.colour = web::distinctColour(s)};
    const auto latency = [](std::int64_t us) { return static_cast<double>(std::max<std::int64_t>(us, 1)); };
    for (std::size_t i = 0; i < both[s].turns.size(); ++i) {
      const double x = static_cast<double>(i) + (s == 0 ? 0.9 : 1.1);
      dots.at.emplace_back(x, latency(both[s].turns[i].percentile(99.9)));
      bars.at.insert(bars.at.end(), {dots.at.back(), {x, latency(both[s].turns[i].max())}});
      bars.lift();
    }
    turns.series.push_back(std::move(bars));
    turns.series.push_back(std::move(dots));
  }
  report.plot(shares);
  report.plot(turns);
}

std::string machine() {
  utsname name{};
  ::uname(&name);
  return std::string(name.sysname) + " " + name.release + " " + name.version + ", " +
         std::to_string(::sysconf(_SC_NPROCESSORS_ONLN)) + " CPUs";
}

int reportRealtime(const RealtimeOptions& options) {
  rt::HeapReserve::takeOverAllocator();
  std::filesystem::create_directories(options.out);
  rt::RealtimeConfig config;
  config.soft = options.soft;
  config.hard_priority = options.priority;
  config.cpu_wake_us = options.cpu_wake_us;
  if (options.cpu >= 0) config.hard_cpus = {options.cpu};
  const rt::CpuWakeLimit wake(config.cpu_wake_us);
  HardLoop loop(config);
  rt::MemoryBudget budget(512 * kMebibyte);  // the libraries of every report are locked too
  rt::HeapReserve heap;
  const rt::ArmingResult armed = rt::arm(config, budget, heap, 16 * kMebibyte);
  std::fputs(armed.table().c_str(), stdout);
  if (!armed.complete()) std::fputs(armed.message().c_str(), stderr);
  if (!armed.armed()) return kExitFailedWork;

  std::vector<std::unique_ptr<ChildProcess>> load;
  const auto run = [&](const std::string& command, const std::filesystem::path& log) {
    load.push_back(std::make_unique<ChildProcess>(
        ChildProcess::Options{{"/bin/sh", "-c", command}, {}, log, std::nullopt}));
  };
  for (int i = 0; i < options.hogs; ++i) run(kHog, "/dev/null");
  if (!options.load.empty()) run(kOverAndOver + options.load + " || sleep 1; done", options.out / "load.log");

  std::vector<Series> both{{"fathom's loop", {}}, {"cyclictest", {}}};
  rt::ThreadCost cost;
  std::uint64_t late_cycles = 0, samples = 0;
  std::int64_t max_body_ns = 0;
  for (int turn = 0; turn < options.turns; ++turn) {
    const HardLoop::Result result = loop.run(options.turn_seconds * kSecond_ns);
    both[0].turns.push_back(result.latency);
    cost.heap_calls += result.cost.heap_calls;
    cost.minor_faults += result.cost.minor_faults;
    cost.major_faults += result.cost.major_faults;
    late_cycles += result.late_cycles;
    samples += result.samples;
    max_body_ns = std::max(max_body_ns, result.max_body_ns);
    both[1].turns.push_back(runCyclictest(options));
    std::printf("turn %2d:", turn + 1);
    for (const Series& series : both)
      std::printf(" %s p99.9 %lld us, max %lld us;", series.name.c_str(),
                  static_cast<long long>(series.turns.back().percentile(99.9)),
                  static_cast<long long>(series.turns.back().max()));
    std::printf("\n");
    std::fflush(stdout);
  }
  for (const auto& child : load) ::kill(-child->pid(), SIGKILL);

  const test::Interval ratio = ratioInterval(both[0].turns, both[1].turns, 99.9);
  Page page("Wake-up latency at 100 Hz, SCHED_FIFO " + std::to_string(options.priority) + ", " +
            std::to_string(options.hogs) + " hogs" + (options.load.empty() ? "" : " and " + options.load));
  page.add(percentiles(both));
  page.add(
      {"Ratio of p99.9", {{"ratio", 2}, {"from", 2}, {"to", 2}}, {{ratio.value, ratio.low, ratio.high}}});
  page.add({"The loop after arming",
            {{"heap calls", 0},
             {"minor faults", 0},
             {"major faults", 0},
             {"slipped", 0},
             {"samples", 0},
             {"longest body [us]", 1}},
            {{cell(cost.heap_calls), cell(cost.minor_faults), cell(cost.major_faults), cell(late_cycles),
              cell(samples), static_cast<double>(max_body_ns) / 1000}}});
  page.add({"Conditions",
            {{"machine", 0}, {"turn [s]", 0}, {"CPU", 0}, {"wake limit [us]", 0}, {"held", 0}, {"soft", 0}},
            {{machine(), cell(options.turn_seconds), cell(options.cpu), cell(options.cpu_wake_us),
              cell(wake.held()), cell(!armed.complete())}}});
  std::printf("%s", page.text().c_str());
  addPlots(both, page.report());
  page.add(turnsTable(both));
  page.write(options.out, "realtime");
  return kExitSuccess;
}

}  // namespace

void realtimeReport(CommandLine& program) {
  static RealtimeOptions o;
  CommandLine& command = program.command(
      "realtime", "Wake-up latency of the hard tier's 100 Hz loop against cyclictest's, turn by turn", "",
      [] { return reportRealtime(o); });
  command.shown("--minutes", o.turns, "turns of each", 1, 1000);
  command.shown("--turn-seconds", o.turn_seconds, "length of a turn [s]", 1, 3600);
  command.shown("--priority", o.priority, "SCHED_FIFO priority of both", 1, 98);
  command.shown("--cpu", o.cpu, "CPU of both; -1: any", -1, 1023);
  command.shown("--hogs", o.hogs, "shells that do nothing but run", 0, 64);
  command.add_option("--load-command", o.load, "run beside, over and over");
  command.shown("--cpu-wake-us", o.cpu_wake_us, "limit on the CPUs' wake-up while the loop's program runs");
  command.add_flag("--soft", o.soft, "continue without privileges");
  command.add_option("--out", o.out, "folder for realtime.html and realtime.json");
}

}  // namespace fathom::bench
