#include "telemetry/monitor/frame_feed.hpp"

#include <array>

#include "realtime/kernel/clock.hpp"

namespace fathom::monitor {

std::size_t LiveFeed::poll(const std::function<void(std::span<const std::uint8_t>, std::int64_t)>& take) {
  constexpr std::size_t kMost = 1000;  // a flooded port must not keep the caller from its other work
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
  std::size_t count = 0;
  for (const auto& port : ports_) {
    for (std::size_t size; count < kMost && (size = port->receive(buffer)) > 0; ++count)
      take(std::span<const std::uint8_t>(buffer).first(size), rt::RealClock().utcNs());
  }
  return count;
}

std::size_t RecordedFeed::poll(const std::function<void(std::span<const std::uint8_t>, std::int64_t)>& take) {
  std::size_t count = 0;
  const std::int64_t now = rt::RealClock().monotonicNs();
  while (!finished_ && count < kBatch) {
    if (!next_) {
      try {
        next_ = reader_.next();
      } catch (...) {
        finished_ = true;
        throw;
      }
    }
    if (!next_) {
      finished_ = true;
      break;
    }
    if (!begun_) {
      begun_ = true;
      first_utc_ns_ = next_->utc_ns;
      begun_monotonic_ns_ = now;
    }
    const double due_ns = speed_ > 0 ? static_cast<double>(next_->utc_ns - first_utc_ns_) / speed_ : 0;
    if (due_ns > static_cast<double>(now - begun_monotonic_ns_)) break;
    take(next_->bytes, next_->utc_ns);
    next_.reset();
    ++count;
  }
  return count;
}

}  // namespace fathom::monitor
