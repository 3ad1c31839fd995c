#include "recon/closure/dot_kernels.hpp"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace fathom::closure {
namespace {

// Values as descriptors have them, the largest among them.
std::vector<std::int16_t> vectors(int count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<std::int16_t> values(static_cast<std::size_t>(count) * kDotLength);
  for (std::int16_t& v : values) v = static_cast<std::int16_t>(random() % 256);
  for (std::size_t k = 0; k < kDotLength && !values.empty(); ++k) values[k] = 255;
  return values;
}

TEST(DotProducts, AreExactInEveryInstructionSetForAnyNumberOfVectors) {
  for (const auto& [n, m] : {std::pair{0, 5}, {5, 0}, {1, 1}, {3, 4}, {7, 9}, {33, 34}}) {
    const auto x = vectors(n, 1), y = vectors(m, 2);
    std::vector<float> expected(static_cast<std::size_t>(n * m)), fastest(expected), baseline(expected);
    for (int j = 0; j < m; ++j)
      for (int i = 0; i < n; ++i) {
        long sum = 0;
        for (int k = 0; k < kDotLength; ++k)
          sum += static_cast<long>(x[static_cast<std::size_t>(kDotLength * i + k)]) *
                 y[static_cast<std::size_t>(kDotLength * j + k)];
        expected[static_cast<std::size_t>(i + n * j)] = static_cast<float>(sum);
      }
    fastestDotProducts()(x.data(), n, y.data(), m, fastest.data());
    baselineDotProducts()(x.data(), n, y.data(), m, baseline.data());
    EXPECT_EQ(fastest, expected) << n << " x " << m;
    EXPECT_EQ(baseline, expected) << n << " x " << m;
  }
}

}  // namespace
}  // namespace fathom::closure
