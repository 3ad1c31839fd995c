#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <ranges>
#include <span>

namespace fathom {

// The functions take their values by value and reorder them: pass a copy of a vector that must stay; the
// elements behind a span are reordered.

// Standard deviation of a normal variable over its median absolute deviation.
inline constexpr double kMadToSigma = 1.4826;

// The value with rank `place` (0: the smallest).
template <typename Values>
[[nodiscard]] auto ranked(Values values, std::size_t place) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(place);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// The median, the greater of the two middle values of an even number; `none` if there are no values.
template <typename Values>
[[nodiscard]] auto median(Values values, std::ranges::range_value_t<Values> none = {}) {
  const std::size_t middle = values.size() / 2;
  return values.empty() ? none : ranked(std::move(values), middle);
}

// Robust standard deviation: kMadToSigma times the median absolute deviation about `centre`. The elements
// behind a span become their absolute deviations.
template <typename Values>
[[nodiscard]] double madSigma(Values values, double centre) {
  for (double& v : values) v = std::abs(v - centre);
  return kMadToSigma * median(std::move(values));
}

// Quantile of sorted values (at least one), `share` in 0 to 1, with linear interpolation between two values.
[[nodiscard]] inline double quantile(std::span<const double> sorted, double share) {
  const double place = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (place - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

}  // namespace fathom
