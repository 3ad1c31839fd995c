#include "telemetry/monitor/frame_feed.hpp"

#include <algorithm>
#include <array>

#include "realtime/base/input_error.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::monitor {

std::size_t LiveFeed::poll(const TakeFrame& take) {
  constexpr std::size_t kMost = 1000;  // a flooded port must not keep the caller from its other work
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
  std::size_t count = 0;
  for (const auto& port : ports_) {
    for (std::size_t size; count < kMost && (size = port->receive(buffer)) > 0; ++count)
      if (take(std::span<const std::uint8_t>(buffer).first(size), rt::RealClock().utcNs()))
        port->answerLastSender();
  }
  return count;
}

bool LiveFeed::send(std::span<const std::uint8_t> frame) {
  bool taken = false;
  for (const auto& port : ports_) taken = port->send(frame) || taken;
  return taken;
}

Recording::Recording(const std::filesystem::path& packets) {
  telemetry::PacketLogReader reader(packets);
  try {
    while (auto packet = reader.next()) packets_.push_back(std::move(*packet));
  } catch (const InputError& error) {
    if (packets_.empty()) throw;
    damage_ = error.what();
  }
  if (packets_.empty())
    throw InputError(packets.string(), "", "is empty: give a packets.bin that holds frames");
  for (const auto& packet : packets_) last_ns_ = std::max(last_ns_, packet.utc_ns);
  at_ns_ = anchor_utc_ns_ = firstUtcNs();
}

void Recording::anchor(std::int64_t monotonic_ns) {
  anchor_utc_ns_ = at_ns_;
  anchor_monotonic_ns_ = monotonic_ns;
}

void Recording::setSpeed(double speed, std::int64_t monotonic_ns) {
  speed_ = speed;
  anchor(monotonic_ns);
}

void Recording::setPlaying(bool playing, std::int64_t monotonic_ns) {
  playing_ = playing;
  anchor(monotonic_ns);
}

bool Recording::seek(std::int64_t utc_ns, std::int64_t monotonic_ns) {
  const bool back = utc_ns < at_ns_;
  if (back) next_ = 0;
  at_ns_ = std::clamp(utc_ns, firstUtcNs(), lastUtcNs());
  anchor(monotonic_ns);
  return back;
}

std::size_t Recording::poll(const TakeFrame& take, std::int64_t monotonic_ns) {
  if (anchor_monotonic_ns_ == 0) anchor(monotonic_ns);
  if (playing_) {
    const double passed = speed_ * static_cast<double>(monotonic_ns - anchor_monotonic_ns_);
    const double left = static_cast<double>(last_ns_ - anchor_utc_ns_);
    at_ns_ = speed_ > 0 && passed < left ? anchor_utc_ns_ + static_cast<std::int64_t>(passed) : last_ns_;
  }
  // After a clock step a frame may be stamped earlier than the one before it: it is due.
  std::size_t count = 0;
  for (; count < kBatch && !finished() && packets_[next_].utc_ns <= at_ns_; ++count, ++next_)
    (void)take(packets_[next_].bytes, packets_[next_].utc_ns);
  return count;
}

}  // namespace fathom::monitor
