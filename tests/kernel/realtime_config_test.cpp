#include "realtime/kernel/threads/realtime_config.hpp"

#include <gtest/gtest.h>

#include "realtime/base/input_error.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::rt {
namespace {

RealtimeConfig read(const std::string& text) {
  const ConfigTable file = ConfigTable::parse("[realtime]\n" + text, "onboard.toml");
  RealtimeConfig config = readKeys(file.table("realtime"), RealtimeConfig{}, visitRealtime);
  file.finish();
  return config;
}

std::string refusal(const std::string& text) {
  return test::refusal([&] { (void)read(text); });
}

TEST(RealtimeConfig, AnEmptyTableGivesTheDefaults) {
  const RealtimeConfig config = read("");
  EXPECT_FALSE(config.soft);
  EXPECT_EQ(config.period_ns, 10'000'000);
  EXPECT_EQ(config.hard_priority, 80);
  EXPECT_TRUE(config.hard_cpus.empty());
}

TEST(RealtimeConfig, ReadsEveryKey) {
  const RealtimeConfig config = read(
      "soft = true\nperiod_ms = 5\nhard_priority = 50\ndevice_priority = 49\ncamera_priority = 48\n"
      "soft_priority = 0\nbest_effort_nice = 7\nhard_cpus = [1]\nsoft_cpus = [0, 1]\nbest_effort_cpus = [0]\n"
      "stack_kib = 256\nlibrary_stack_kib = 512\nstuck_after_s = 1.5\n"
      "cpu_wake_us = -1\n");
  EXPECT_TRUE(config.soft);
  EXPECT_EQ(config.period_ns, 5'000'000);
  EXPECT_EQ(highestPriority(config), 50);
  EXPECT_EQ(config.soft_cpus, (std::vector<int>{0, 1}));
  EXPECT_EQ(config.stack_bytes, 256u * 1024);
  EXPECT_EQ(config.library_stack_bytes, 512u * 1024);
  EXPECT_EQ(config.stuck_after_ns, 1'500'000'000);

  EXPECT_EQ(config.cpu_wake_us, -1);

  const ThreadConfig hard = threadConfig(config, Tier::kHard, "nav");
  EXPECT_EQ(hard.fifo_priority, 50);
  EXPECT_EQ(hard.cpus, std::vector<int>{1});
  const ThreadConfig vision = threadConfig(config, Tier::kSoft, "vision");
  EXPECT_EQ(vision.fifo_priority, 0);
  EXPECT_EQ(threadConfig(config, Tier::kBestEffort, "recorder").nice, 7);
  EXPECT_EQ(threadConfig(config, Tier::kCamera, "left").fifo_priority, 48);
}

TEST(RealtimeConfig, RefusesWhatCannotBe) {
  EXPECT_NE(refusal("hard_priority = 99").find("line 2"), std::string::npos);
  EXPECT_NE(refusal("hard_cpus = [0.5]").find("whole numbers"), std::string::npos);
  EXPECT_NE(refusal("hard_cpus = [-1]").find("out of range"), std::string::npos);
  EXPECT_NE(refusal("hard_priority = 10\nsoft_priority = 10").find("below hard_priority"), std::string::npos);
  EXPECT_NE(refusal("prio = 1").find("unknown"), std::string::npos);
}

TEST(MemoryConfig, ReadsMebibytesAndRefusesAHeapAsLargeAsTheBudget) {
  const ConfigTable good = ConfigTable::parse("budget_mib = 512\nheap_mib = 64\n", "f.toml");
  const MemoryConfig config = readKeys(good, MemoryConfig{}, visitMemory);
  EXPECT_EQ(config.budget_bytes, std::size_t{512} << 20);
  EXPECT_EQ(config.heap_bytes, std::size_t{64} << 20);
  EXPECT_THROW((void)readKeys(ConfigTable::parse("budget_mib = 64\nheap_mib = 64\n", "f.toml"),
                              MemoryConfig{}, visitMemory),
               InputError);
}

}  // namespace
}  // namespace fathom::rt
