#include <gtest/gtest.h>
#include "realtime/kernel/time/clock.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "realtime/base/numbers/log_histogram.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/latency_histogram.hpp"
#include "tests/support/manual_clock.hpp"

namespace fathom::rt {
namespace {

constexpr std::int64_t kPeriod = 10'000'000;

TEST(PeriodicLoop, WakesOnEveryDeadlineWithoutDrift) {
  test::ManualClock clock;
  PeriodicLoop loop(clock, kPeriod);
  std::vector<std::int64_t> begun;
  for (int i = 0; i < 5; ++i)
    loop.runOnce([&] {
      begun.push_back(clock.monotonicNs());
      clock.advance(3'000'000);
    });
  for (std::size_t i = 0; i < begun.size(); ++i)
    EXPECT_EQ(begun[i], static_cast<std::int64_t>(i + 1) * kPeriod);
  EXPECT_EQ(loop.statistics().cycles, 5u);
  EXPECT_EQ(loop.statistics().skipped_cycles, 0u);
  EXPECT_EQ(loop.statistics().max_body_ns, 3'000'000);
  EXPECT_EQ(loop.statistics().jitter_ns.max(), 0);
}

TEST(PeriodicLoop, SkipsAndCountsTheDeadlinesThatALongBodyMissed) {
  test::ManualClock clock;
  PeriodicLoop loop(clock, kPeriod);
  loop.runOnce([&] { clock.advance(25'000'000); });  // begun at 10 ms, ends at 35 ms: misses 20 and 30 ms
  EXPECT_EQ(loop.statistics().skipped_cycles, 2u);
  EXPECT_EQ(loop.nextDeadlineNs(), 4 * kPeriod);
  loop.runOnce([&] { EXPECT_EQ(clock.monotonicNs(), 4 * kPeriod); });
  EXPECT_EQ(loop.statistics().skipped_cycles, 2u);
  EXPECT_EQ(loop.statistics().max_body_ns, 25'000'000);
}

TEST(PeriodicLoop, ABodyThatJustFillsItsPeriodSkipsNoDeadline) {
  test::ManualClock clock;
  PeriodicLoop loop(clock, kPeriod);
  for (int i = 0; i < 3; ++i) loop.runOnce([&] { clock.advance(kPeriod); });
  EXPECT_EQ(loop.statistics().skipped_cycles, 0u);
  EXPECT_EQ(loop.statistics().jitter_ns.max(), 0);
}

// A clock that wakes late, as a loaded machine does.
class LateClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t monotonicNs() const noexcept override { return inner_.monotonicNs(); }
  [[nodiscard]] std::int64_t utcNs() const noexcept override { return inner_.utcNs(); }
  void sleepUntil(std::int64_t monotonic_ns) noexcept override {
    inner_.sleepUntil(monotonic_ns);
    inner_.advance(lateness_);
    lateness_ += 1000;
  }

 private:
  test::ManualClock inner_;
  std::int64_t lateness_ = 1000;
};

TEST(PeriodicLoop, MeasuresHowLateEachCycleBegins) {
  LateClock clock;
  PeriodicLoop loop(clock, kPeriod);
  for (int i = 0; i < 4; ++i) loop.runOnce([] {});
  EXPECT_EQ(loop.statistics().jitter_ns.min(), 1000);
  EXPECT_EQ(loop.statistics().jitter_ns.max(), 4000);
  EXPECT_EQ(loop.statistics().jitter_ns.count(), 4u);
}

TEST(PeriodicLoop, RunsUntilTheBodySaysStop) {
  test::ManualClock clock;
  PeriodicLoop loop(clock, kPeriod);
  int cycles = 0;
  loop.run([&] { return ++cycles < 7; });
  EXPECT_EQ(cycles, 7);
  EXPECT_EQ(clock.monotonicNs(), 7 * kPeriod);
}

TEST(PeriodicLoop, CyclesOnTheRealClockWithoutHeapCalls) {
  RealClock clock;
  PeriodicLoop loop(clock, 1'000'000);
  const test::ThreadCost before = test::threadCost();
  for (int i = 0; i < 10; ++i) loop.runOnce([] {});
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_EQ(loop.statistics().cycles, 10u);
}

TEST(LogHistogram, IsZeroWhenEmpty) {
  const LogHistogram histogram;
  EXPECT_EQ(histogram.count(), 0u);
  EXPECT_EQ(histogram.min(), 0);
  EXPECT_EQ(histogram.max(), 0);
  EXPECT_EQ(histogram.percentile(50), 0);
}

TEST(LogHistogram, GivesOneValueBackExactlyWhateverItsSize) {
  for (std::int64_t value : {std::int64_t{0}, std::int64_t{15}, std::int64_t{16}, std::int64_t{1'234'567},
                             std::int64_t{INT64_MAX}}) {
    LogHistogram histogram;
    histogram.add(value);
    EXPECT_EQ(histogram.percentile(0), value);
    EXPECT_EQ(histogram.percentile(100), value);
    EXPECT_EQ(histogram.max(), value);
  }
}

TEST(LogHistogram, CountsNegativeValuesAsZero) {
  LogHistogram histogram;
  histogram.add(-5);
  EXPECT_EQ(histogram.count(), 1u);
  EXPECT_EQ(histogram.min(), 0);
  EXPECT_EQ(histogram.max(), 0);
}

TEST(LogHistogram, PercentilesStayWithinASixteenthOfTheSortedValues) {
  std::mt19937_64 random(7);
  std::lognormal_distribution<double> spread(10.0, 3.0);
  std::vector<std::int64_t> values;
  LogHistogram histogram;
  for (int i = 0; i < 5000; ++i) {
    values.push_back(static_cast<std::int64_t>(spread(random)));
    histogram.add(values.back());
  }
  std::sort(values.begin(), values.end());
  for (double percent : {1.0, 25.0, 50.0, 95.0, 99.0, 99.9, 100.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(percent / 100.0 * 5000.0)) - 1;
    const double truth = static_cast<double>(values[rank]);
    const double got = static_cast<double>(histogram.percentile(percent));
    EXPECT_GE(got, truth) << percent;
    EXPECT_LE(got, truth * (1 + 1.0 / 16)) << percent;
  }
}

}  // namespace
}  // namespace fathom::rt

namespace fathom::test {
namespace {

const std::string kPrinted =
    "# /dev/cpu_dma_latency set to 0us\n"
    "# Histogram\n000000 000000\n000012 000003\n000013\t000096\n"
    "# Total: 000000099\n# Min Latencies: 00012\n# Avg Latencies: 00061\n# Max Latencies: 22667\n"
    "# Histogram Overflows: 00001\n# Histogram Overflow at cycle number:\n# Thread 0: 00002 00003\n";

TEST(LatencyHistogram, ReadsWhatCyclictestPrints) {
  const auto histogram = readCyclictest(kPrinted);
  ASSERT_TRUE(histogram);
  EXPECT_EQ(histogram->count(), 100u);
  EXPECT_EQ(histogram->beyond(), 1u);
  EXPECT_EQ(histogram->max(), 22667);
  EXPECT_EQ(histogram->percentile(50), 13);
  EXPECT_EQ(histogram->percentile(2), 12);
  EXPECT_EQ(histogram->percentile(99.9), static_cast<std::int64_t>(LatencyHistogram::kMicroseconds));
}

TEST(LatencyHistogram, RefusesWhatIsNoWholeHistogram) {
  EXPECT_FALSE(readCyclictest(""));
  EXPECT_FALSE(readCyclictest("FATAL: could not access /dev/cpu_dma_latency\n"));
  EXPECT_FALSE(readCyclictest("000012 000003\n"));                       // no total
  EXPECT_FALSE(readCyclictest(kPrinted.substr(kPrinted.find("13\t"))));  // rows are missing
  EXPECT_FALSE(readCyclictest("# Total: 0\n# Histogram Overflows: 0\n"));
}

LatencyHistogram minute(std::uint64_t seed, double scale) {
  std::mt19937_64 random(seed);
  std::lognormal_distribution<double> latency(3.0, 0.7);
  LatencyHistogram histogram;
  for (int i = 0; i < 6000; ++i) histogram.add(static_cast<std::int64_t>(scale * latency(random)));
  return histogram;
}

TEST(LatencyIntervals, MostlyHoldTheTruthAndAreNotEndless) {
  // p99.9 of the distribution, exp(3 + 0.7 * 3.09), rounded down as histograms do.
  constexpr double kTruth = 174, kRatio = 1.2;
  constexpr int kRepeats = 20, kMost = 15;  // of 95 % intervals
  int held = 0, ratio_held = 0;
  for (std::uint64_t repeat = 0; repeat < kRepeats; ++repeat) {
    std::vector<LatencyHistogram> ours, theirs;
    for (std::uint64_t i = 0; i < 15; ++i) {
      ours.push_back(minute(1000 * repeat + i, kRatio));
      theirs.push_back(minute(1000 * repeat + 100 + i, 1.0));
    }
    const Interval p999 = percentileInterval(theirs, 99.9);
    const Interval ratio = ratioInterval(ours, theirs, 99.9);
    held += p999.low <= kTruth && kTruth <= p999.high;
    ratio_held += ratio.low <= kRatio && kRatio <= ratio.high;
    EXPECT_LT(p999.high - p999.low, 0.3 * kTruth);
    EXPECT_LT(ratio.high - ratio.low, 0.4);
  }
  EXPECT_GE(held, kMost);
  EXPECT_GE(ratio_held, kMost);
}

TEST(LatencyIntervals, OneMinuteGivesItsOwnValue) {
  const std::vector<LatencyHistogram> one{minute(1, 1)};
  const Interval interval = percentileInterval(one, 50);
  EXPECT_EQ(interval.low, interval.value);
  EXPECT_EQ(interval.high, interval.value);
  EXPECT_NEAR(interval.value, 20, 2);
}

}  // namespace
}  // namespace fathom::test
