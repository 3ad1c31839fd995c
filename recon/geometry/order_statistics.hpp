#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <ranges>
#include <span>

namespace fathom {

// Values are taken by value and reordered: of a vector that stays, a copy; of a span, what it shows.

// Standard deviation of a normal variable over its median absolute deviation.
inline constexpr double kMadToSigma = 1.4826;

// The value that `place` others come before in order.
template <typename Values>
[[nodiscard]] auto ranked(Values values, std::size_t place) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(place);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// The median, of an even number the greater of the two in the middle; `none` of nothing.
template <typename Values>
[[nodiscard]] auto median(Values values, std::ranges::range_value_t<Values> none = {}) {
  return values.empty() ? none : ranked(std::move(values), values.size() / 2);
}

// Standard deviation of a normal variable with the same median absolute deviation about `centre`. A span's
// values become their deviations.
template <typename Values>
[[nodiscard]] double madSigma(Values values, double centre) {
  for (double& v : values) v = std::abs(v - centre);
  return kMadToSigma * median(std::move(values));
}

// What this share of sorted values (at least one) lies below, on the line between two of them.
[[nodiscard]] inline double quantile(std::span<const double> sorted, double share) {
  const double place = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (place - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

}  // namespace fathom
