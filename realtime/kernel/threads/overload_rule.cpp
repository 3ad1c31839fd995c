#include "realtime/kernel/threads/overload_rule.hpp"

#include <algorithm>
#include <cassert>

namespace fathom::rt {
namespace {

constexpr DegradationLevel above(DegradationLevel level) {
  return static_cast<DegradationLevel>(
      std::min<int>(static_cast<int>(level) + 1, static_cast<int>(DegradationLevel::kDropFrames)));
}

}  // namespace

OverloadRule::OverloadRule(const OverloadConfig& config) noexcept
    : config_(config), lower_after_(config.lower_after) {
  assert(config.raise_after > 0 && config.lower_after > 0);
  config_.lower_at = std::min(config.lower_at, config.raise_at);
  config_.max_lower_after = std::max(config.max_lower_after, config.lower_after);
}

void OverloadRule::raiseTo(DegradationLevel level) noexcept {
  slow_in_a_row_ = easy_in_a_row_ = 0;
  if (level == this->level()) return;
  if (lowering_on_trial_) lower_after_ = std::min(2 * lower_after_, config_.max_lower_after);
  lowering_on_trial_ = false;
  level_.store(level, std::memory_order_relaxed);
  ++statistics_.raised;
}

void OverloadRule::lower() noexcept {
  slow_in_a_row_ = easy_in_a_row_ = 0;
  level_.store(static_cast<DegradationLevel>(static_cast<int>(level()) - 1), std::memory_order_relaxed);
  lowering_on_trial_ = true;
  since_lowered_ = 0;
  ++statistics_.lowered;
}

OverloadRule::Decided OverloadRule::decide(const Observation& o) noexcept {
  const auto period = static_cast<double>(o.period_ns);
  const auto frame = static_cast<double>(o.last_frame_ns);
  // A pair that has waited for more than a period is late, however fast the last frame was.
  const bool slow = frame > config_.raise_at * period || o.waiting >= config_.waiting_limit ||
                    static_cast<double>(o.age_ns) > (1 + config_.raise_at) * period;
  const bool easy = !slow && frame < config_.lower_at * period && o.waiting == 0;

  slow_in_a_row_ = slow ? slow_in_a_row_ + 1 : 0;
  easy_in_a_row_ = easy ? easy_in_a_row_ + 1 : 0;
  if (lowering_on_trial_ && ++since_lowered_ >= lower_after_) {
    lowering_on_trial_ = false;
    if (level() == DegradationLevel::kFull) lower_after_ = config_.lower_after;
  }

  if (o.waiting >= config_.drop_waiting) {
    raiseTo(DegradationLevel::kDropFrames);
  } else if (slow_in_a_row_ >= config_.raise_after) {
    raiseTo(above(level()));
  } else if (easy_in_a_row_ >= lower_after_ && level() != DegradationLevel::kFull) {
    lower();
  }

  const Decided decided{level(), level() == DegradationLevel::kDropFrames && o.waiting > 1};
  ++statistics_.pairs[static_cast<std::size_t>(decided.level)];
  if (decided.drop) ++statistics_.dropped;
  return decided;
}

}  // namespace fathom::rt
