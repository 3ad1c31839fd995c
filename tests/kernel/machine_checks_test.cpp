#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>

#include "realtime/kernel/threads/machine_checks.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::rt {
namespace {

using testing::ElementsAre, testing::HasSubstr, testing::IsEmpty;

// A machine of four CPUs whose last is the hard tier's, set up as it should be.
const std::map<std::string, std::string> kWellSetUp = {
    {"sys/kernel/realtime", "1"},
    {"proc/sys/kernel/sched_rt_runtime_us", "-1"},
    {"proc/sys/kernel/sched_rt_period_us", "1000000"},
    {"sys/devices/system/clocksource/clocksource0/current_clocksource", "arch_sys_counter"},
    {"sys/devices/system/clocksource/clocksource0/available_clocksource", "arch_sys_counter"},
    {"sys/devices/system/cpu/online", "0-3"},
    {"sys/devices/system/cpu/isolated", "3"},
    {"sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance"},
    {"sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "performance"},
    {"proc/irq/1/smp_affinity_list", "0-2"},
    {"proc/irq/24/smp_affinity_list", "0-3"},
    {"proc/irq/24/effective_affinity_list", "1"},
};

std::vector<ArmingCheck> checksOf(std::map<std::string, std::string> files, const std::string& path = "",
                                  const std::string& content = "", std::vector<int> hard_cpus = {3}) {
  const test::TemporaryFolder folder;
  if (!path.empty()) files[path] = content;
  for (const auto& [name, line] : files) {
    std::filesystem::create_directories((folder.path() / name).parent_path());
    std::ofstream(folder.path() / name) << line << '\n';
  }
  RealtimeConfig config;
  config.hard_cpus = std::move(hard_cpus);
  return checkMachine(config, folder.path());
}

std::vector<std::string> unmet(const std::vector<ArmingCheck>& checks) {
  std::vector<std::string> names;
  for (const ArmingCheck& check : checks) {
    EXPECT_FALSE(check.required) << check.name;
    if (check.ok) continue;
    names.push_back(check.name);
    EXPECT_NE(check.missing, "") << check.name;
    EXPECT_NE(check.grant, "") << check.name;
  }
  return names;
}

const ArmingCheck& named(const std::vector<ArmingCheck>& checks, const std::string& name) {
  return *std::find_if(checks.begin(), checks.end(), [&](const ArmingCheck& c) { return c.name == name; });
}

TEST(MachineChecks, AMachineInOrderMeetsAll) {
  EXPECT_THAT(unmet(checksOf(kWellSetUp)), IsEmpty());
}

TEST(MachineChecks, EachSettingThatIsWrongIsNamedWithWhatToSet) {
  struct Wrong {
    const char *path, *content;
    std::vector<std::string> names;  // the first is looked at
    const char *missing, *grant;
    std::vector<int> hard_cpus = {3};
  };
  const std::vector<Wrong> settings = {
      {"sys/kernel/realtime", "0", {"kernel"}, "not PREEMPT_RT", "linux-image-rt-arm64"},
      {"sys/devices/system/clocksource/clocksource0/current_clocksource",
       "hpet",
       {"clock source"},
       "hpet",
       "clocksource="},
      {"sys/devices/system/cpu/isolated",
       "1-2",
       {"isolated CPUs", "interrupts"},
       "CPU 3 of hard_cpus",
       "isolcpus=managed_irq,domain,2,3",
       {2, 3}},
      {"proc/irq/24/effective_affinity_list",
       "2-3",
       {"interrupts"},
       "1 of 2 on hard_cpus (24)",
       "IRQBALANCE_BANNED_CPULIST=3"},
      {"sys/devices/system/cpu/cpu3/cpufreq/scaling_governor",
       "schedutil",
       {"frequency governors"},
       "schedutil on CPU 3",
       "performance"},
  };
  for (const Wrong& wrong : settings) {
    const auto checks = checksOf(kWellSetUp, wrong.path, wrong.content, wrong.hard_cpus);
    EXPECT_EQ(unmet(checks), wrong.names) << wrong.path;
    EXPECT_THAT(named(checks, wrong.names.front()).missing, HasSubstr(wrong.missing));
    EXPECT_THAT(named(checks, wrong.names.front()).grant, HasSubstr(wrong.grant));
  }
}

TEST(MachineChecks, WithoutCpusOfItsOwnTheHardTierIsAdvisedToHaveOne) {
  const auto checks = checksOf(kWellSetUp, "", "", {});
  EXPECT_THAT(unmet(checks), ElementsAre("isolated CPUs"));
  EXPECT_THAT(named(checks, "isolated CPUs").grant, HasSubstr("hard_cpus = [N]"));
}

TEST(MachineChecks, AKernelThatSaysNothingOrNonsenseIsNoFailure) {
  EXPECT_THAT(unmet(checksOf({})), ElementsAre("kernel", "isolated CPUs"));
  EXPECT_THAT(unmet(checksOf(kWellSetUp, "sys/devices/system/cpu/isolated", "3-,x")),
              ElementsAre("isolated CPUs"));
  EXPECT_THAT(unmet(checksOf(kWellSetUp, "sys/devices/system/cpu/online", "0-99999999999")), IsEmpty());
}

}  // namespace
}  // namespace fathom::rt
