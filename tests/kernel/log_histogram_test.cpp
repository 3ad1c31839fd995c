#include "realtime/base/numbers/log_histogram.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace fathom::rt {
namespace {

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
