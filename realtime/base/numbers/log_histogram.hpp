#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace fathom::rt {

// Histogram of non-negative integers (times in ns, sizes) in fixed memory. Buckets are exact below 16; above,
// each octave has 16 buckets, so that a percentile is at most 1/16 above the true value. For one thread; copy
// it to publish it.
class LogHistogram {
 public:
  // Negative values count as 0.
  void add(std::int64_t value) noexcept;
  void clear() noexcept { *this = LogHistogram(); }

  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }
  [[nodiscard]] std::int64_t min() const noexcept { return count_ == 0 ? 0 : min_; }
  [[nodiscard]] std::int64_t max() const noexcept { return max_; }
  // Smallest bucket bound (at most max()) that at least `percent` (0 to 100) of the values do not exceed; 0
  // when empty.
  [[nodiscard]] std::int64_t percentile(double percent) const noexcept;

 private:
  static constexpr int kSubBits = 4;
  static constexpr std::size_t kSub = std::size_t{1} << kSubBits;
  static constexpr int kValueBits = 63;
  static constexpr std::size_t kBuckets = (kValueBits - kSubBits + 1) * kSub;

  static std::size_t bucketOf(std::uint64_t value) noexcept;
  static std::uint64_t upperBound(std::size_t bucket) noexcept;  // largest value of the bucket

  std::array<std::uint64_t, kBuckets> buckets_{};
  std::uint64_t count_ = 0;
  std::int64_t min_ = 0;
  std::int64_t max_ = 0;
};

}  // namespace fathom::rt
