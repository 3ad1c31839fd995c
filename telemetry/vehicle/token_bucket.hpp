#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace fathom::telemetry {

// Limits a rate: over any window of W seconds at most rate * W + capacity bits are taken. Whole numbers, so
// that the same calls give the same answers everywhere. One unit of credit is 1e-12 bit (millibits per second
// times ns).
class TokenBucket {
 public:
  // `rate_bps` 10 to 1e6 bit/s, capacities up to 4 Mbit: all products stay inside 63 bits.
  TokenBucket(double rate_bps, std::size_t capacity_bits, std::size_t initial_bits)
      : rate_(std::llround(rate_bps * 1000)),
        capacity_(static_cast<std::int64_t>(capacity_bits) * kUnitsPerBit),
        credit_(static_cast<std::int64_t>(initial_bits) * kUnitsPerBit) {}

  void advance(std::int64_t now_ns) {
    if (started_ && now_ns > last_ns_) {
      const std::int64_t until_full = (capacity_ - credit_) / rate_ + 1;
      credit_ = std::min(capacity_, credit_ + std::min(now_ns - last_ns_, until_full) * rate_);
    }
    last_ns_ = started_ ? std::max(last_ns_, now_ns) : now_ns;
    started_ = true;
  }
  [[nodiscard]] bool has(std::size_t bits) const {
    return credit_ >= static_cast<std::int64_t>(bits) * kUnitsPerBit;
  }
  void take(std::size_t bits) { credit_ -= static_cast<std::int64_t>(bits) * kUnitsPerBit; }

  // For saved state (state_archive.hpp), bit by bit, into one of the same rate and capacity.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.instants(self.last_ns_);
    archive(self.credit_, self.started_);
    archive.require(self.credit_ <= self.capacity_ && self.credit_ >= -self.capacity_,
                    "credit that cannot be");
  }

 private:
  static constexpr std::int64_t kUnitsPerBit = 1'000'000'000'000;
  std::int64_t rate_;  // [millibit/s]
  std::int64_t capacity_;
  std::int64_t credit_;
  std::int64_t last_ns_ = 0;
  bool started_ = false;
};

}  // namespace fathom::telemetry
