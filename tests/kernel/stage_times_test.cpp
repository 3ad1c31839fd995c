#include "realtime/kernel/health/stage_times.hpp"

#include <gtest/gtest.h>

#include <array>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "realtime/kernel/health/trace_json.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::array<StageSpec, 2> kStages{{{"drain", 0}, {"step", 2 * kMs}}};

TEST(StageTimes, SummarisesEachStageByItself) {
  StageTimes times(kStages);
  for (int i = 1; i <= 100; ++i) {
    times.add(0, 0, i * 1000);
    times.add(1, 10, 10 + (i <= 97 ? kMs : 3 * kMs));
  }
  const StageSummary drain = times.summary(0), step = times.summary(1);
  EXPECT_STREQ(drain.name, "drain");
  EXPECT_EQ(drain.count, 100u);
  EXPECT_EQ(drain.last_ns, 100'000);
  EXPECT_EQ(drain.max_ns, 100'000);
  EXPECT_NEAR(static_cast<double>(drain.p50_ns), 50'000, 50'000 / 16.0);
  EXPECT_EQ(drain.misses, 0u);
  EXPECT_EQ(step.misses, 3u);
  EXPECT_EQ(step.max_ns, 3 * kMs);
  EXPECT_EQ(step.p99_ns, 3 * kMs);
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
  TraceThread nav;
  nav.name = "navigation";
  nav.period_ns = nav.deadline_ns = 10 * kMs;
  nav.stages = {"cycle"};
  for (int i = 0; i < 100; ++i)
    nav.events.push_back({0, i * 10 * kMs, i * 10 * kMs + (i == 50 ? slowest : 1) * kMs});
  TraceThread vision;
  vision.name = "vision \"left\"";
  vision.stages = {"frame", "stereo"};
  vision.events = {
      {1, 12 * kMs, 30 * kMs}, {0, 10 * kMs, 70 * kMs}, {7, 60 * kMs, 80 * kMs}, {1, 75 * kMs, 76 * kMs}};
  return nlohmann::json::parse(traceJson("dive", std::vector{nav, vision}, 0, 1000 * kMs));
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

}  // namespace
}  // namespace fathom::rt
