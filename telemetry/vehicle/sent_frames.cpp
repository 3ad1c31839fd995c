#include "telemetry/vehicle/sent_frames.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::telemetry {
namespace {

// Loss is a mean over the last so many frames, or fewer of them where bursts are looked at.
constexpr double kLossMemory = 100;
constexpr double kBurstMemory = 30;

}  // namespace

SentFrames::SentFrames(double round_trip_s, double expected_loss, double expected_burst)
    : round_trip_ns_(std::llround(round_trip_s * 1e9)),
      frames_(kFrames),
      loss_(expected_loss),
      after_lost_(expected_burst > 1 ? 1 - 1 / expected_burst : expected_loss) {}

void SentFrames::add(std::uint16_t sequence, std::int64_t left_ns, std::span<const BlockRef> blocks) {
  Frame& f = frames_[sequence % kFrames];
  if (f.open && f.blocks > 0 && forgotten_) forgotten_(std::span(f.block).first(f.blocks));
  f.open = true;
  f.sequence = sequence;
  f.left_ns = left_ns;
  f.blocks = std::min(blocks.size(), f.block.size());
  std::copy_n(blocks.begin(), f.blocks, f.block.begin());
  next_ = static_cast<std::uint16_t>(sequence + 1);
  held_ = std::min(held_ + 1, kFrames);
}

void SentFrames::skip(std::uint16_t count) {
  for (std::uint16_t i = 0; i < count; ++i, ++next_) {
    Frame& f = frames_[next_ % kFrames];
    if (f.open && f.blocks > 0 && forgotten_) forgotten_(std::span(f.block).first(f.blocks));
    f.open = false;
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

bool SentFrames::acknowledge(const Acknowledgement& a, std::int64_t now_ns, const Word& word) {
  const auto back = static_cast<std::uint16_t>(next_ - 1 - a.newest);
  if (!a.valid || back >= held_) {
    ++counters_.foreign;
    return false;
  }
  ++counters_.acknowledgements;
  for (std::size_t i = held_; i-- > 0;) {  // oldest first
    const auto sequence = static_cast<std::uint16_t>(next_ - 1 - i);
    Frame& f = frames_[sequence % kFrames];
    if (!f.open) continue;
    bool arrived = false;
    if (const auto heard = a.heard(sequence))
      arrived = *heard;
    else if (i < back && now_ns - f.left_ns < round_trip_ns_)
      continue;  // after the newest, and the answer may still come
    f.open = false;
    learn(arrived);
    word(std::span(f.block).first(f.blocks), arrived);
  }
  return true;
}

}  // namespace fathom::telemetry
