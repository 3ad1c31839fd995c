#include "telemetry/vehicle/sent_frames.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/units.hpp"

namespace fathom::telemetry {
namespace {

// Frames in the running means of the loss and of the loss after a lost frame.
constexpr double kLossMemory = 100;
constexpr double kBurstMemory = 30;

}  // namespace

SentFrames::SentFrames(double round_trip_s, double expected_loss, double expected_burst, Version first)
    : round_trip_ns_(rt::nanoseconds(round_trip_s)),
      frames_(kFrames),
      first_(first),
      next_(first),
      loss_(expected_loss),
      after_lost_(expected_burst > 1 ? 1 - 1 / expected_burst : expected_loss) {}

void SentFrames::add(std::int64_t left_ns, std::span<const BlockRef> blocks) {
  Frame& f = frames_[next_ % kFrames];
  f.open = true;
  f.left_ns = left_ns;
  f.blocks = std::min(blocks.size(), f.block.size());
  std::copy_n(blocks.begin(), f.blocks, f.block.begin());
  ++next_;
  held_ = std::min(held_ + 1, kFrames);
}

void SentFrames::leftTogether(Version first, std::int64_t left_ns) {
  for (Version version = first; version < next_; ++version) frames_[version % kFrames].left_ns = left_ns;
}

void SentFrames::skip(Version count) {
  const Version known = std::min<Version>(count, kFrames);
  next_ += count - known;
  for (Version i = 0; i < known; ++i, ++next_) {
    frames_[next_ % kFrames] = Frame{};
    held_ = std::min(held_ + 1, kFrames);
  }
}

void SentFrames::learn(bool arrived) {
  ++(arrived ? counters_.arrived : counters_.lost);
  const double lost = arrived ? 0 : 1;
  loss_ += (lost - loss_) / kLossMemory;
  if (any_word_ && last_lost_) after_lost_ += (lost - after_lost_) / kBurstMemory;
  last_lost_ = !arrived;
  any_word_ = true;
}

double SentFrames::burst() const {
  return 1 / std::max(1 - after_lost_, 0.05);
}

std::optional<Version> SentFrames::newestOf(const Acknowledgement& a) const {
  const Version newest = versionNear(a.newest, next_ - 1);
  if (!a.valid || newest >= next_ || newest < first_) return std::nullopt;
  return newest;
}

std::optional<std::int64_t> SentFrames::leftAt(Version version) const {
  if (version < oldest() || version >= next_) return std::nullopt;
  return frames_[version % kFrames].left_ns;
}

std::optional<bool> SentFrames::wordOf(Version version) const {
  if (version < oldest() || version >= next_ || frames_[version % kFrames].open) return std::nullopt;
  return frames_[version % kFrames].arrived;
}

void SentFrames::acknowledge(const Acknowledgement& a, Version newest, std::int64_t now_ns,
                             const Word& word) {
  ++counters_.acknowledgements;
  const bool latest = newest >= newest_acknowledged_;
  newest_acknowledged_ = std::max(newest_acknowledged_, newest);
  for (Version version = oldest(); version < next_; ++version) {
    Frame& f = frames_[version % kFrames];
    if (!f.open) continue;
    bool arrived = false;
    if (const auto received = version <= newest ? a.receivedBack(newest - version) : std::nullopt)
      arrived = *received;
    else if (!latest || (version > newest && now_ns - f.left_ns < round_trip_ns_))
      continue;  // the acknowledgement is of earlier frames, or the answer may still come
    f.open = false;
    f.arrived = arrived;
    learn(arrived);
    word(version, std::span(f.block).first(f.blocks), arrived);
  }
}

}  // namespace fathom::telemetry
