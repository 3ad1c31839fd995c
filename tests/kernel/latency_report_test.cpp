#include <gtest/gtest.h>

#include <random>
#include <string>

#include "tests/support/latency_histogram.hpp"

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
