#include "telemetry/monitor/model/link_history.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::monitor {

void LinkHistory::add(std::int64_t utc_ns, std::size_t bytes, bool accepted, std::uint64_t lost_so_far) {
  // A clock that started in another year, or a day without a frame: the steps before are dropped.
  const auto length_ns = static_cast<std::int64_t>(steps_.size()) * step_ns_;
  if (!steps_.empty() &&
      (utc_ns - start_ns_ - length_ns > kLongestSilence_ns || start_ns_ - utc_ns > kLongestSilence_ns)) {
    steps_.clear();
    step_ns_ = kFirstStep_ns;
  }
  if (steps_.empty()) start_ns_ = utc_ns - utc_ns % kFirstStep_ns;
  // A clock that was set back adds to the newest step.
  std::int64_t index = utc_ns < start_ns_ ? 0 : (utc_ns - start_ns_) / step_ns_;
  while (index >= static_cast<std::int64_t>(kMaxSteps)) {
    for (std::size_t i = 0; 2 * i < steps_.size(); ++i) {
      Step sum = steps_[2 * i];
      if (2 * i + 1 < steps_.size()) {
        const Step& second = steps_[2 * i + 1];
        sum.bytes += second.bytes;
        sum.accepted += second.accepted;
        sum.rejected += second.rejected;
        sum.lost += second.lost;
      }
      steps_[i] = sum;
    }
    steps_.resize((steps_.size() + 1) / 2);
    step_ns_ *= 2;
    index /= 2;
  }
  const auto at = static_cast<std::size_t>(index);
  if (at >= steps_.size()) steps_.resize(at + 1);
  Step& step = steps_.size() > at + 1 ? steps_.back() : steps_[at];
  step.lost += static_cast<std::int64_t>(lost_so_far) - static_cast<std::int64_t>(lost_);
  lost_ = lost_so_far;
  if (accepted) {
    step.bytes += bytes;
    ++step.accepted;
  } else {
    ++step.rejected;
  }
}

LinkHistory::Recent LinkHistory::recent(double window_s, std::int64_t now_utc_ns) const {
  const auto from = now_utc_ns - static_cast<std::int64_t>(window_s * 1e9);
  double bits = 0, accepted = 0, lost = 0;
  std::int64_t begin = now_utc_ns;
  for (std::size_t i = steps_.size(); i-- > 0;) {
    const std::int64_t at = start_ns_ + static_cast<std::int64_t>(i) * step_ns_;
    if (at + step_ns_ <= from) break;
    begin = at;
    bits += 8.0 * static_cast<double>(steps_[i].bytes);
    accepted += static_cast<double>(steps_[i].accepted);
    lost += static_cast<double>(steps_[i].lost);
  }
  const double span = std::max(window_s, static_cast<double>(now_utc_ns - begin) * 1e-9);
  lost = std::max(lost, 0.0);
  return {bits / span, accepted + lost > 0 ? lost / (accepted + lost) : std::nan("")};
}

}  // namespace fathom::monitor
