#include "realtime/base/numbers/log_histogram.hpp"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>

namespace fathom::rt {

std::size_t LogHistogram::bucketOf(std::uint64_t value) noexcept {
  if (value < kSub) return static_cast<std::size_t>(value);
  // `shift` drops the bits below the leading one and the kSubBits that follow it.
  const int shift = std::bit_width(value) - 1 - kSubBits;
  const std::size_t sub = static_cast<std::size_t>(value >> shift) - kSub;
  return (static_cast<std::size_t>(shift) + 1) * kSub + sub;
}

std::uint64_t LogHistogram::upperBound(std::size_t bucket) noexcept {
  if (bucket < kSub) return bucket;
  const std::size_t shift = bucket / kSub - 1;
  const std::uint64_t first = (kSub + bucket % kSub) << shift;
  return first + ((std::uint64_t{1} << shift) - 1);
}

void LogHistogram::add(std::int64_t value) noexcept {
  value = std::max<std::int64_t>(value, 0);
  ++buckets_[bucketOf(static_cast<std::uint64_t>(value))];
  min_ = count_ == 0 ? value : std::min(min_, value);
  max_ = std::max(max_, value);
  ++count_;
}

std::int64_t LogHistogram::percentile(double percent) const noexcept {
  assert(percent >= 0 && percent <= 100);
  if (count_ == 0) return 0;
  const double wanted = std::max(1.0, std::ceil(percent / 100.0 * static_cast<double>(count_)));
  std::uint64_t below = 0;
  for (std::size_t i = 0; i < kBuckets; ++i) {
    below += buckets_[i];
    if (static_cast<double>(below) >= wanted) return std::min(static_cast<std::int64_t>(upperBound(i)), max_);
  }
  return max_;
}

}  // namespace fathom::rt
