#include "realtime/kernel/health/stage_times.hpp"

#include <gtest/gtest.h>

#include <array>
#include <string>
#include <thread>

#include "realtime/kernel/health/timeline_svg.hpp"
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

// A second of navigation and vision; its fiftieth cycle takes `slowest` ms.
TimelinePicture oneSecond(int slowest = 1) {
  TimelinePicture picture;
  picture.title = "one <second> & more";
  picture.to_ns = 1000 * kMs;
  TimelineRow nav;
  nav.name = "navigation";
  nav.period_ns = 10 * kMs;
  nav.stages = {{"cycle", 100, 1, kMs, kMs, kMs, 12 * kMs}};
  for (int i = 0; i < 100; ++i)
    nav.events.push_back({0, i * 10 * kMs, i * 10 * kMs + (i == 50 ? slowest : 1) * kMs});
  TimelineRow vision;
  vision.name = "vision";
  vision.stages = {{"frame", 2, 0, kMs, kMs, kMs, kMs}, {"stereo", 2, 0, kMs, kMs, kMs, kMs}};
  vision.events = {{1, 12 * kMs, 30 * kMs}, {0, 10 * kMs, 70 * kMs}, {7, 500 * kMs, 520 * kMs}};
  picture.rows = {nav, vision};
  return picture;
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++found;
  return found;
}

TEST(TimelineSvg, DrawsEveryStageWithItsLengthAndTheDeadlines) {
  const std::string svg = timelineSvg(oneSecond());
  EXPECT_EQ(count(svg, "<title>frame 60.0 ms</title>"), 2u);  // in both panels
  EXPECT_EQ(count(svg, "<title>stereo 18.0 ms</title>"), 2u);
  EXPECT_GE(count(svg, "<title>cycle 1.0 ms</title>"), 99u);
  EXPECT_EQ(count(svg, "<title>stage 7 20.0 ms</title>"), 1u);  // no name known
  EXPECT_GE(count(svg, "class='due'"), 100u);
  EXPECT_NE(svg.find("one &lt;second&gt; &amp; more"), std::string::npos);
}

TEST(TimelineSvg, MarksTheCycleThatRanPastItsNextDeadlineAndNoOther) {
  const char* const mark = "fill='#cc0000'";
  EXPECT_EQ(count(timelineSvg(oneSecond()), mark), 0u);
  EXPECT_EQ(count(timelineSvg(oneSecond(9)), mark), 0u);
  // In the whole second, in the part enlarged, which now shows it, and as the cycle shown by itself.
  EXPECT_EQ(count(timelineSvg(oneSecond(12)), mark), 3u);
}

TEST(TimelineSvg, AnEmptyPictureIsAPictureAllTheSame) {
  const std::string svg = timelineSvg({});
  EXPECT_EQ(svg.find("nan"), std::string::npos);
  EXPECT_NE(svg.find("</svg>"), std::string::npos);
}

TEST(TimelineRow, TakesTheLastSecondsOfARunningThread) {
  TimelineTrack track(64);
  StageTimes times(kStages, &track);
  for (int i = 0; i < 20; ++i) times.add(0, i * 100 * kMs, i * 100 * kMs + kMs);
  times.publish();
  const TimelineRow row = timelineRow("nav", "", times, track, 2000 * kMs, 1000 * kMs);
  EXPECT_EQ(row.events.size(), 10u);
  ASSERT_EQ(row.stages.size(), 2u);
  EXPECT_EQ(row.stages[0].count, 20u);
}

}  // namespace
}  // namespace fathom::rt
