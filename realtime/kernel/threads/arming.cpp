#include "realtime/kernel/threads/arming.hpp"

#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <fstream>
#include <string_view>
#include <system_error>
#include <utility>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/threads/machine_checks.hpp"

namespace fathom::rt {
namespace {

std::string mibText(std::size_t bytes) {
  return formatted("%.1f MiB", mebibytes(bytes));
}

std::string limitText(rlim_t limit) {
  return limit == RLIM_INFINITY ? "unlimited" : std::to_string(limit);
}

rlimit limitOf(__rlimit_resource_t resource) {
  rlimit limit{};
  ::getrlimit(resource, &limit);
  return limit;
}

// Whether this process has a capability, from /proc (capget would need libcap's names).
bool hasCapability(int number) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    constexpr std::string_view kKey = "CapEff:";
    if (!line.starts_with(kKey)) continue;
    const auto set = std::stoull(line.substr(kKey.size()), nullptr, 16);
    return (set >> number & 1) != 0;
  }
  return false;
}
constexpr int kCapIpcLock = 14;  // linux/capability.h
constexpr const char* kLockedMemory = "locked memory";

// `missing` and `grant` are of a check that is not met.
ArmingCheck checked(bool ok, std::string name, std::string found, std::string missing, std::string grant) {
  ArmingCheck check;
  check.name = std::move(name);
  check.ok = ok;
  check.found = std::move(found);
  if (ok) return check;
  check.missing = std::move(missing);
  check.grant = std::move(grant);
  return check;
}

ArmingCheck checkPriority(const RealtimeConfig& config) {
  const std::string priority = std::to_string(highestPriority(config));
  ThreadConfig thread;
  thread.name = "arming";
  thread.fifo_priority = highestPriority(config);
  RtThread trial(thread);
  const bool started = trial.start([] {});
  trial.join();
  const std::string limit = limitText(limitOf(RLIMIT_RTPRIO).rlim_cur);
  const bool ok = started && trial.refused().empty();
  return checked(ok, "SCHED_FIFO", ok ? "priority " + priority + " granted" : "RLIMIT_RTPRIO " + limit,
                 "priority " + priority + " refused (" +
                     (trial.refused().empty() ? "no thread" : trial.refused().front()) +
                     "), RLIMIT_RTPRIO is " + limit,
                 "LimitRTPRIO=" + priority + " or AmbientCapabilities=CAP_SYS_NICE");
}

ArmingCheck checkCpus(const RealtimeConfig& config) {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  ::sched_getaffinity(0, sizeof allowed, &allowed);
  std::string refused;
  for (const auto* list : {&config.hard_cpus, &config.soft_cpus, &config.best_effort_cpus})
    for (const int cpu : *list)
      if (cpu >= CPU_SETSIZE || !CPU_ISSET(static_cast<std::size_t>(cpu), &allowed))
        refused += (refused.empty() ? "" : ", ") + std::to_string(cpu);
  return checked(
      refused.empty(), "CPUs",
      std::to_string(CPU_COUNT(&allowed)) + " allowed of " + std::to_string(::sysconf(_SC_NPROCESSORS_ONLN)),
      "CPU " + refused + " of [realtime] is absent or not allowed",
      "CPUAffinity= with these CPUs, or none; or correct hard_cpus, soft_cpus, best_effort_cpus");
}

ArmingCheck checkBudget(const MemoryBudget& budget) {
  const std::string planned = mibText(budget.plannedBytes()), allowed = mibText(budget.budgetBytes());
  return checked(budget.fits(), "memory budget", planned + " planned of " + allowed,
                 "the pools need " + planned + ", [memory] budget_mib allows " + allowed,
                 "raise budget_mib, or make pools smaller (--print-budget lists them)");
}

// Reads "Key:  123 kB" of /proc/meminfo [bytes]; 0 where it does not say.
std::size_t memInfo(std::string_view key) {
  std::ifstream file("/proc/meminfo");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with(key)) return std::stoull(line.substr(key.size() + 1)) * 1024;
  return 0;
}

ArmingCheck checkAvailable(const MemoryBudget& budget, std::size_t resident) {
  const std::size_t available = memInfo("MemAvailable"), planned = budget.plannedBytes();
  const std::size_t to_come = planned > resident ? planned - resident : 0;
  const std::string found = mibText(available) + " available";
  return checked(available == 0 || available >= to_come, "memory of the machine", found,
                 mibText(to_come) + " still to be taken, " + found,
                 "end other programs, or lower the budget");
}

std::string lockGrant() {
  return "LimitMEMLOCK=infinity or AmbientCapabilities=CAP_IPC_LOCK";
}

ArmingCheck checkLockLimit(const MemoryBudget& budget) {
  const rlim_t limit = limitOf(RLIMIT_MEMLOCK).rlim_cur;
  const bool capable = hasCapability(kCapIpcLock);
  // mlockall counts address space, so that a finite limit is hardly ever sufficient; the attempt decides.
  return checked(
      capable || limit == RLIM_INFINITY || limit >= budget.budgetBytes(), kLockedMemory,
      capable ? "CAP_IPC_LOCK" : "RLIMIT_MEMLOCK " + limitText(limit),
      "RLIMIT_MEMLOCK is " + limitText(limit) + " bytes, the budget " + mibText(budget.budgetBytes()),
      lockGrant());
}

void lockMemory(ArmingCheck& check) {
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) == 0) {
    leaveBulkData();
    check.found = "all, present and future";
    return;
  }
  const int error = errno;
  populateMappings();
  check.ok = false;
  check.missing = "mlockall refused (" + std::generic_category().message(error) + "), RLIMIT_MEMLOCK is " +
                  limitText(limitOf(RLIMIT_MEMLOCK).rlim_cur) + " bytes";
  check.grant = lockGrant();
}

// Resident set once everything is in place: reveals memory that the plan omits.
ArmingCheck checkResident(const MemoryBudget& budget) {
  const std::size_t resident = exactResidentBytes();
  const std::string is = mibText(resident), allowed = mibText(budget.budgetBytes());
  return checked(resident <= budget.budgetBytes(), "resident set", is + " of " + allowed,
                 is + " are resident, [memory] budget_mib allows " + allowed,
                 "raise budget_mib, or make pools or heap_mib smaller (--print-budget lists them)");
}

}  // namespace

bool ArmingResult::complete() const noexcept {
  return std::all_of(checks.begin(), checks.end(), [](const ArmingCheck& c) { return c.ok || !c.required; });
}

std::string ArmingResult::missingNames() const {
  std::string names;
  for (const ArmingCheck& check : checks)
    if (!check.ok && check.required) names += (names.empty() ? "" : ", ") + check.name;
  return names;
}

std::string ArmingResult::message() const {
  if (complete()) return "";
  std::string text = soft ? "armed in soft mode, without real time:\n" : "not armed:\n";
  for (const ArmingCheck& check : checks)
    if (!check.ok && check.required)
      text += "  " + check.name + ": " + check.missing + "\n    needs " + check.grant + "\n";
  if (!soft) text += "  or run with --soft, which continues without it and reports that in every status\n";
  return text;
}

std::string ArmingResult::table() const {
  std::string text;
  for (const ArmingCheck& check : checks)
    text += formatted("%-8s %-24s %s\n",
                      !check.required ? "note"
                      : check.ok      ? "ok"
                                      : "MISSING",
                      check.name.c_str(), (check.ok ? check.found : check.missing).c_str());
  return text;
}

ArmingResult checkArming(const RealtimeConfig& realtime, const MemoryBudget& budget) {
  ArmingResult result;
  result.soft = realtime.soft;
  result.checks = {checkPriority(realtime), checkCpus(realtime), checkBudget(budget),
                   checkAvailable(budget, exactResidentBytes()), checkLockLimit(budget)};
  for (ArmingCheck& check : checkMachine(realtime)) result.checks.push_back(std::move(check));
  return result;
}

ArmingResult arm(const RealtimeConfig& realtime, const MemoryBudget& budget, HeapReserve& heap,
                 std::size_t heap_bytes) {
  ArmingResult result = checkArming(realtime, budget);
  if (!result.armed()) return result;
  const ArmingCheck reserve =
      checked(heap.reserve(heap_bytes), "heap reserve", mibText(heap_bytes) + " taken",
              "the system has no " + mibText(heap_bytes) + " for it",
              "lower heap_mib, or give the machine more memory");
  lockMemory(*std::find_if(result.checks.begin(), result.checks.end(),
                           [](const ArmingCheck& c) { return c.name == kLockedMemory; }));
  result.checks.push_back(reserve);
  result.checks.push_back(checkResident(budget));
  return result;
}

CpuWakeLimit::CpuWakeLimit(int microseconds) noexcept {
  if (microseconds < 0) return;
  file_ = ::open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
  const std::int32_t limit = microseconds;
  // The limit holds for as long as the file is open.
  if (file_ >= 0 && ::write(file_, &limit, sizeof limit) != sizeof limit) {
    ::close(file_);
    file_ = -1;
  }
}

CpuWakeLimit::~CpuWakeLimit() {
  if (file_ >= 0) ::close(file_);
}

}  // namespace fathom::rt
