#include "realtime/kernel/health/system_status.hpp"

#include <gtest/gtest.h>

#include "tests/support/heap_counter.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::rt {
namespace {

TEST(SystemStatus, ReadsTheHottestZoneTheSlowestCpuAndAllThrottles) {
  const test::TemporaryFolder root;
  test::writeText(root.path() / "sys/class/thermal/thermal_zone0/temp", "41500\n");
  test::writeText(root.path() / "sys/class/thermal/thermal_zone1/temp", "66000\n");
  test::writeText(root.path() / "sys/class/thermal/cooling_device0/temp", "99000\n");
  for (const char* cpu : {"cpu0", "cpu1"}) {
    const auto folder = root.path() / "sys/devices/system/cpu" / cpu;
    test::writeText(folder / "thermal_throttle/core_throttle_count", "3\n");
    test::writeText(folder / "cpufreq/cpuinfo_max_freq", "2000000\n");
    test::writeText(folder / "cpufreq/scaling_cur_freq",
                    std::string(cpu) == "cpu0" ? "2000000\n" : "500000\n");
  }
  test::writeText(root.path() / "proc/loadavg", "1.25 0.80 0.40 2/345 6789\n");
  const SystemFigures figures = SystemStatus(root.path(), root.path()).read();
  EXPECT_FLOAT_EQ(figures.cpu_temperature_c.value(), 66.0F);
  EXPECT_FLOAT_EQ(figures.frequency_share.value(), 0.25F);
  EXPECT_EQ(figures.thermal_throttles.value(), 6u);
  EXPECT_FLOAT_EQ(figures.load.value(), 1.25F);
  EXPECT_GT(figures.disk_free_bytes.value(), 0u);
  EXPECT_GE(figures.disk_total_bytes.value(), figures.disk_free_bytes.value());
}

TEST(SystemStatus, WhatTheSystemDoesNotTellIsAbsent) {
  const test::TemporaryFolder root;
  test::writeText(root.path() / "sys/class/thermal/thermal_zone0/temp", "no number\n");
  test::writeText(root.path() / "proc/loadavg", "");
  const SystemFigures figures = SystemStatus("/no/such/folder", root.path()).read();
  EXPECT_FALSE(figures.cpu_temperature_c);
  EXPECT_FALSE(figures.frequency_share);
  EXPECT_FALSE(figures.thermal_throttles);
  EXPECT_FALSE(figures.load);
  EXPECT_FALSE(figures.disk_free_bytes);
}

TEST(SystemStatus, ReadsThisMachineWithoutHeap) {
  const SystemStatus status("/");
  const test::ThreadCost before = test::threadCost();
  const SystemFigures figures = status.read();
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_TRUE(figures.disk_free_bytes);
  EXPECT_TRUE(figures.load);
}

}  // namespace
}  // namespace fathom::rt
