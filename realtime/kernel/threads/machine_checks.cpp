#include "realtime/kernel/threads/machine_checks.hpp"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <set>
#include <string>
#include <string_view>
#include <utility>

namespace fathom::rt {
namespace {

using Path = std::filesystem::path;

std::string firstLine(const Path& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

// "0-2,5", as the kernel writes lists of CPUs. What is no such list is none.
std::set<int> cpusOf(std::string_view list) {
  std::set<int> cpus;
  const char *at = list.data(), *end = at + list.size();
  constexpr int kMostCpus = 8192;
  while (at < end) {
    int first = 0;
    auto read = std::from_chars(at, end, first);
    if (read.ec != std::errc{}) return cpus;
    int last = first;
    if (read.ptr < end && *read.ptr == '-') read = std::from_chars(read.ptr + 1, end, last);
    if (read.ec != std::errc{}) return cpus;
    for (int cpu = first; cpu <= std::min(last, kMostCpus); ++cpu) cpus.insert(cpu);
    at = read.ptr < end && *read.ptr == ',' ? read.ptr + 1 : end;
  }
  return cpus;
}

// The same, without ranges: short lists for people.
template <class Cpus>
std::string listOf(const Cpus& cpus) {
  std::string out;
  for (const int cpu : cpus) out += (out.empty() ? "" : ",") + std::to_string(cpu);
  return out;
}

ArmingCheck met(std::string name, std::string found) {
  ArmingCheck check;
  check.name = std::move(name);
  check.required = false;
  check.found = std::move(found);
  return check;
}

ArmingCheck wanting(std::string name, std::string found, std::string grant) {
  ArmingCheck check = met(std::move(name), found);
  check.ok = false;
  check.missing = std::move(found);
  check.grant = std::move(grant);
  return check;
}

ArmingCheck checkKernel(const Path& root) {
  if (firstLine(root / "sys/kernel/realtime") == "1") return met("kernel", "PREEMPT_RT");
  return wanting("kernel", "not PREEMPT_RT: a driver may hold the hard tier back for milliseconds",
                 "install linux-image-rt-arm64 or linux-image-rt-amd64");
}

ArmingCheck checkThrottling(const Path& root) {
  const std::string runtime = firstLine(root / "proc/sys/kernel/sched_rt_runtime_us");
  const std::string period = firstLine(root / "proc/sys/kernel/sched_rt_period_us");
  return met("real-time throttling",
             runtime == "-1" ? "off" : runtime + " of " + period + " us for real-time threads");
}

ArmingCheck checkClockSource(const Path& root) {
  const Path folder = root / "sys/devices/system/clocksource/clocksource0";
  const std::string now = firstLine(folder / "current_clocksource");
  // These are read over a bus, at a microsecond or more each time.
  if (now != "hpet" && now != "acpi_pm" && now != "jiffies") return met("clock source", now);
  return wanting("clock source", now + ", which is slow to read",
                 "one of \"" + firstLine(folder / "available_clocksource") +
                     "\" by clocksource= on the kernel's command line; tsc is best on x86");
}

ArmingCheck checkIsolation(const RealtimeConfig& config, const Path& root) {
  const std::string name = "isolated CPUs";
  if (config.hard_cpus.empty())
    return wanting(name, "hard_cpus is empty: the hard tier shares its CPU with everything else",
                   "hard_cpus = [N] in [realtime] of onboard.toml, with isolcpus= for the same CPU");
  const std::set<int> isolated = cpusOf(firstLine(root / "sys/devices/system/cpu/isolated"));
  std::vector<int> shared;
  for (const int cpu : config.hard_cpus)
    if (isolated.count(cpu) == 0) shared.push_back(cpu);
  if (shared.empty()) return met(name, listOf(config.hard_cpus) + " for the hard tier alone");
  const std::string all = listOf(config.hard_cpus);
  return wanting(name, "CPU " + listOf(shared) + " of hard_cpus also runs other programs",
                 "isolcpus=managed_irq,domain," + all + " nohz_full=" + all + " rcu_nocbs=" + all +
                     " on the kernel's command line");
}

ArmingCheck checkInterrupts(const RealtimeConfig& config, const Path& root) {
  const std::string name = "interrupts";
  if (config.hard_cpus.empty()) return met(name, "on any CPU, as the hard tier");
  constexpr std::size_t kNamed = 8;
  std::size_t all = 0, here = 0;
  std::string numbers;
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator(root / "proc/irq", none)) {
    // Where the kernel does not say where they go, where they may go.
    std::string list = firstLine(entry.path() / "effective_affinity_list");
    if (list.empty()) list = firstLine(entry.path() / "smp_affinity_list");
    if (list.empty()) continue;
    ++all;
    const std::set<int> cpus = cpusOf(list);
    if (std::none_of(config.hard_cpus.begin(), config.hard_cpus.end(),
                     [&](int cpu) { return cpus.count(cpu) != 0; }))
      continue;
    if (here++ < kNamed) numbers += (numbers.empty() ? "" : ", ") + entry.path().filename().string();
  }
  const std::string found = std::to_string(here) + " of " + std::to_string(all) + " on hard_cpus";
  if (here == 0) return met(name, found);
  return wanting(name, found + " (" + numbers + (here > kNamed ? ", ..." : "") + ")",
                 "irqaffinity= with the other CPUs on the kernel's command line, or their numbers into "
                 "/proc/irq/N/smp_affinity_list; IRQBALANCE_BANNED_CPULIST=" +
                     listOf(config.hard_cpus) + " where irqbalance runs");
}

ArmingCheck checkGovernors(const Path& root) {
  const std::string name = "frequency governors";
  std::set<std::string> others;
  std::vector<int> cpus;
  bool any = false;
  for (const int cpu : cpusOf(firstLine(root / "sys/devices/system/cpu/online"))) {
    const std::string number = std::to_string(cpu);
    const std::string governor =
        firstLine(root / "sys/devices/system/cpu" / ("cpu" + number) / "cpufreq/scaling_governor");
    any = any || !governor.empty();
    if (governor.empty() || governor == "performance") continue;
    others.insert(governor);
    cpus.push_back(cpu);
  }
  if (!any) return met(name, "none: the frequency is not this kernel's to change");
  if (others.empty()) return met(name, "performance");
  std::string kinds;
  for (const std::string& kind : others) kinds += (kinds.empty() ? "" : ", ") + kind;
  return wanting(name, kinds + " on CPU " + listOf(cpus) + ": a CPU is slow when it wakes",
                 "cpupower frequency-set --governor performance, or cpufreq.default_governor=performance on "
                 "the kernel's command line");
}

}  // namespace

std::vector<ArmingCheck> checkMachine(const RealtimeConfig& config, const Path& root) {
  return {checkKernel(root),
          checkThrottling(root),
          checkClockSource(root),
          checkIsolation(config, root),
          checkInterrupts(config, root),
          checkGovernors(root)};
}

}  // namespace fathom::rt
