#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace fathom::test {

// Wake-up latencies counted by whole microseconds, as cyclictest counts them (rounded down).
class LatencyHistogram {
 public:
  static constexpr std::size_t kMicroseconds = 20'000;  // two periods of the loop; later is counted apart

  LatencyHistogram() : counts_(kMicroseconds, 0) {}

  void add(std::int64_t latency_us, std::uint64_t times = 1) noexcept;
  // So late that it has no place of its own; its size is known only when it is the latest.
  void addBeyond(std::uint64_t times, std::int64_t max_us) noexcept;
  void merge(const LatencyHistogram& other) noexcept;

  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }
  [[nodiscard]] std::uint64_t beyond() const noexcept { return beyond_; }
  [[nodiscard]] std::int64_t max() const noexcept { return max_; }  // [us]
  [[nodiscard]] const std::vector<std::uint64_t>& counts() const noexcept { return counts_; }
  // Smallest latency that `percent` of the wake-ups do not exceed [us]; kMicroseconds for those beyond.
  [[nodiscard]] std::int64_t percentile(double percent) const noexcept;

 private:
  std::vector<std::uint64_t> counts_;
  std::uint64_t count_ = 0, beyond_ = 0;
  std::int64_t max_ = 0;
};

// What cyclictest printed with one thread and -h; std::nullopt when that is no such histogram, or one that
// does not add up to its own total.
[[nodiscard]] std::optional<LatencyHistogram> readCyclictest(std::string_view printed);

struct Interval {
  double value = 0, low = 0, high = 0;  // low and high hold it with 95 % confidence
};

// Of the percentile of all minutes together, and of the ratio of two such percentiles, by drawing whole
// minutes with replacement (2000 times): latencies of one minute are no independent draws. For the ratio
// minute i of one stands for minute i of the other, since they ran one after the other.
[[nodiscard]] Interval percentileInterval(const std::vector<LatencyHistogram>& minutes, double percent);
[[nodiscard]] Interval ratioInterval(const std::vector<LatencyHistogram>& ours,
                                     const std::vector<LatencyHistogram>& theirs, double percent);

}  // namespace fathom::test
