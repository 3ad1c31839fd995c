#include "realtime/onboard/nav/stereo_pairing.hpp"

#include <algorithm>
#include <cstdlib>

namespace fathom::onboard {

std::optional<StereoPairing::Pair> StereoPairing::add(CameraSide side, const Frame& frame) noexcept {
  Stream& own = streams_[static_cast<std::size_t>(side)];
  Stream& other = streams_[1 - static_cast<std::size_t>(side)];
  const std::int64_t before_ns = own.times.any() ? own.times.newestUtcNs() : 0;
  if (own.times.check(frame.utc_ns) != nav::TimeCheck::kGood) {
    ++refused_;
    return std::nullopt;
  }
  if (before_ns != 0 && (period_ns_ == 0 || frame.utc_ns - before_ns < period_ns_))
    period_ns_ = frame.utc_ns - before_ns;
  // So much wider only as no other frame comes into question.
  const std::int64_t drift_ns = driftAt(frame.utc_ns);
  const std::int64_t within_ns = tolerance_ns_ + (2 * drift_ns + tolerance_ns_ < period_ns_ ? drift_ns : 0);

  // The frame's time by the other camera's clock.
  const std::int64_t expected_ns =
      side == CameraSide::kLeft ? frame.utc_ns + skew_ns_ : frame.utc_ns - skew_ns_;
  // A frame earlier than this one by more than the tolerance matches no later one either.
  while (!other.waiting.empty() && other.waiting.front().utc_ns < expected_ns - within_ns) {
    other.waiting.popFront();
    ++other.unpaired;
  }
  std::size_t nearest = other.waiting.size();
  std::int64_t nearest_ns = within_ns;
  for (std::size_t i = 0; i < other.waiting.size(); ++i) {
    const std::int64_t difference = std::abs(other.waiting[i].utc_ns - expected_ns);
    if (difference > nearest_ns) continue;
    nearest = i;
    nearest_ns = difference;
  }
  if (nearest == other.waiting.size()) {
    if (own.waiting.pushDroppingOldest(frame)) ++own.unpaired;
    return std::nullopt;
  }

  const Frame partner = other.waiting[nearest];
  for (std::size_t i = 0; i < nearest; ++i) {
    other.waiting.popFront();
    ++other.unpaired;
  }
  other.waiting.popFront();
  const Pair pair = side == CameraSide::kLeft ? Pair{frame, partner} : Pair{partner, frame};
  followSkew(pair);
  return pair;
}

std::int64_t StereoPairing::driftAt(std::int64_t utc_ns) const noexcept {
  return newest_pair_ns_ == 0 ? 0 : std::max<std::int64_t>(utc_ns - newest_pair_ns_, 0) / kDriftShare;
}

void StereoPairing::followSkew(const Pair& pair) noexcept {
  const std::int64_t drift_ns = driftAt(pair.left.utc_ns);
  newest_pair_ns_ = pair.left.utc_ns;
  const std::int64_t off_ns = pair.right.utc_ns - pair.left.utc_ns - skew_ns_;
  const std::int64_t follow_ns = std::abs(off_ns) > tolerance_ns_ ? off_ns : off_ns / kSkewFollow;
  skew_ns_ += std::clamp(follow_ns, -drift_ns, drift_ns);
}

}  // namespace fathom::onboard
