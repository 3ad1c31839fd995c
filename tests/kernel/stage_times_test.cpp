#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <thread>

#include "realtime/base/units.hpp"
#include "realtime/kernel/health/stage_times.hpp"
#include "realtime/kernel/health/system_status.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::rt {
namespace {

constexpr std::array<StageSpec, 2> kStages{{{"drain", 0}, {"step", 2 * kMillisecond_ns}}};

TEST(StageTimes, SummarisesEachStageByItself) {
  StageTimes times(kStages);
  for (int i = 1; i <= 100; ++i) {
    times.add(0, 0, i * 1000);
    times.add(1, 10, 10 + (i <= 97 ? kMillisecond_ns : 3 * kMillisecond_ns));
  }
  const StageSummary drain = times.summary(0), step = times.summary(1);
  EXPECT_STREQ(drain.name, "drain");
  EXPECT_EQ(drain.count, 100u);
  EXPECT_EQ(drain.last_ns, 100'000);
  EXPECT_EQ(drain.max_ns, 100'000);
  EXPECT_NEAR(static_cast<double>(drain.p50_ns), 50'000, 50'000 / 16.0);
  EXPECT_EQ(drain.misses, 0u);
  EXPECT_EQ(step.misses, 3u);
  EXPECT_EQ(step.max_ns, 3 * kMillisecond_ns);
  EXPECT_EQ(step.p99_ns, 3 * kMillisecond_ns);
}

TEST(StageTimes, AReaderGetsWhatWasPublishedAndNothingBefore) {
  StageTimes times(kStages);
  StageTimes::Snapshot snapshot;
  EXPECT_FALSE(times.read(snapshot));
  times.add(0, 0, 5);
  times.publish();
  times.add(0, 0, 7);
  ASSERT_TRUE(times.read(snapshot));
  ASSERT_EQ(snapshot.stages, 2u);
  EXPECT_EQ(snapshot.all()[0].last_ns, 5);
  EXPECT_EQ(snapshot.all()[1].count, 0u);
}

TEST(StageTimes, AddingAndPublishingTakeNoHeap) {
  TimelineTrack track(64);
  StageTimes times(kStages, &track);
  const test::ThreadCost before = test::threadCost();
  for (int i = 0; i < 1000; ++i) times.add(1, i, i + 10);
  times.publish();
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
}

TEST(TimelineTrack, KeepsTheNewestEventsAndGivesThoseAskedFor) {
  TimelineTrack track(4);
  EXPECT_TRUE(track.copy(0, 1000).empty());
  for (int i = 0; i < 10; ++i) track.add(static_cast<std::uint16_t>(i), i * 10, i * 10 + 5);
  const auto all = track.copy(0, 1000);
  ASSERT_EQ(all.size(), 4u);
  EXPECT_EQ(all.front().stage, 6);
  EXPECT_EQ(all.back().begin_ns, 90);
  const auto some = track.copy(76, 90);
  ASSERT_EQ(some.size(), 1u);
  EXPECT_EQ(some[0].stage, 8);
}

TEST(TimelineTrack, AReaderGetsWholeEventsWhileAnotherThreadWrites) {
  TimelineTrack track(8);
  std::thread writer([&] {
    for (std::int64_t i = 1; i <= 200'000; ++i)
      track.add(static_cast<std::uint16_t>(i % 60'000), i, i + i % 1000);
  });
  std::size_t seen = 0;
  for (int i = 0; i < 2000; ++i)
    for (const TimelineEvent& e : track.copy(0, INT64_MAX)) {
      ++seen;
      ASSERT_EQ(e.end_ns, e.begin_ns + e.begin_ns % 1000);
      ASSERT_EQ(e.stage, e.begin_ns % 60'000);
    }
  writer.join();
  seen += track.copy(0, INT64_MAX).size();
  EXPECT_GT(seen, 0u);
}

// A second of navigation and vision; the fiftieth cycle takes `slowest` ms.
nlohmann::json oneSecond(int slowest) {
  TraceThread nav{.name = "navigation", .stages = {}, .events = {}};
  nav.period_ns = nav.deadline_ns = 10 * kMillisecond_ns;
  nav.stages = {"cycle"};
  for (int i = 0; i < 100; ++i)
    nav.events.push_back(
        {0, i * 10 * kMillisecond_ns, i * 10 * kMillisecond_ns + (i == 50 ? slowest : 1) * kMillisecond_ns});
  TraceThread vision;
  vision.name = "vision \"left\"";
  vision.stages = {"frame", "stereo"};
  vision.events = {{1, 12 * kMillisecond_ns, 30 * kMillisecond_ns},
                   {0, 10 * kMillisecond_ns, 70 * kMillisecond_ns},
                   {7, 60 * kMillisecond_ns, 80 * kMillisecond_ns},
                   {1, 75 * kMillisecond_ns, 76 * kMillisecond_ns}};
  return nlohmann::json::parse(traceJson("dive", std::vector{nav, vision}, 0, 1000 * kMillisecond_ns));
}

std::vector<nlohmann::json> named(const nlohmann::json& trace, const std::string& name) {
  std::vector<nlohmann::json> found;
  for (const auto& event : trace.at("traceEvents"))
    if (event.at("name") == name) found.push_back(event);
  return found;
}

TEST(TraceJson, TellsEveryStageWithItsBeginAndLengthOnItsThread) {
  const nlohmann::json trace = oneSecond(1);
  EXPECT_EQ(named(trace, "cycle").size(), 100u);
  const auto frame = named(trace, "frame");
  ASSERT_EQ(frame.size(), 1u);
  EXPECT_EQ(frame[0].at("ph"), "X");
  EXPECT_EQ(frame[0].at("ts"), 10'000);
  EXPECT_EQ(frame[0].at("dur"), 60'000);
  EXPECT_EQ(named(trace, "stage 7").size(), 1u);  // no name known
  const auto threads = named(trace, "thread_name");
  ASSERT_EQ(threads.size(), 3u);  // vision has two
  EXPECT_EQ(threads[1].at("args").at("name"), "vision \"left\"");
  EXPECT_EQ(threads[1].at("tid"), frame[0].at("tid"));
}

TEST(TraceJson, StagesThatOverlapWithoutHoldingOneAnotherAreOnTracksOfTheirOwn) {
  const nlohmann::json trace = oneSecond(1);
  const auto frame = named(trace, "frame")[0], other = named(trace, "stage 7")[0];
  const auto stereo = named(trace, "stereo");
  EXPECT_EQ(stereo[0].at("tid"), frame.at("tid"));
  EXPECT_NE(other.at("tid"), frame.at("tid"));
  EXPECT_EQ(stereo[1].at("tid"), frame.at("tid")) << "the frame was over";
}

TEST(TraceJson, MarksTheDeadlinesAndThoseThatACycleRanPast) {
  EXPECT_EQ(named(oneSecond(9), "deadline").size(), 100u);
  const auto missed = named(oneSecond(12), "missed deadline");
  ASSERT_EQ(missed.size(), 1u);
  EXPECT_EQ(missed[0].at("ts"), 510'000);
}

TEST(TraceJson, IsWellFormedWithoutAnything) {
  EXPECT_EQ(nlohmann::json::parse(traceJson("", {}, 0, 1)).at("traceEvents").size(), 1u);
}

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

TEST(SystemStatus, ReadingsThatTheSystemLacksAreAbsent) {
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
