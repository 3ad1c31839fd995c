#include "realtime/kernel/threads/watchdog.hpp"

#include <algorithm>
#include <cassert>

namespace fathom::rt {

std::size_t Watchdog::add(const TierSpec& spec) noexcept {
  assert(count_ < kMaxTiers && spec.limit_ns > 0);
  states_.at(count_).shown.spec = spec;
  return count_++;
}

void Watchdog::watch(std::size_t tier, std::int64_t now_ns) noexcept {
  assert(tier < count_);
  Watch& w = states_.at(tier);
  w.shown.watched = true;
  w.shown.stuck = w.shown.given_up = false;
  w.shown.silent_ns = 0;
  w.beats_seen = hearts_.at(tier).beats();
  w.last_life_ns = now_ns;
  w.restarts_in_a_row = 0;
}

void Watchdog::unwatch(std::size_t tier) noexcept {
  assert(tier < count_);
  TierState& state = states_.at(tier).shown;
  state.watched = state.stuck = state.given_up = false;
  state.silent_ns = 0;
}

bool Watchdog::look(std::size_t tier, std::int64_t now_ns, Remedy& remedy) noexcept {
  Watch& w = states_[tier];
  TierState& state = w.shown;
  if (!state.watched) return false;

  const std::uint64_t beats = hearts_[tier].beats();
  if (beats != w.beats_seen) {
    w.beats_seen = beats;
    // The beat's own time where it is a sane one, so that a slow supervisor does not hide a silence.
    w.last_life_ns = std::clamp(hearts_[tier].lastNs(), w.last_life_ns, std::max(now_ns, w.last_life_ns));
  }
  state.silent_ns = std::max<std::int64_t>(now_ns - w.last_life_ns, 0);
  state.longest_silent_ns = std::max(state.longest_silent_ns, state.silent_ns);

  if (state.silent_ns < state.spec.limit_ns) {
    if (!state.stuck) return false;
    state.stuck = state.given_up = false;
    w.restarts_in_a_row = 0;
    remedy = Remedy::kRecovered;
    return true;
  }
  if (!state.stuck) {
    state.stuck = true;
    ++state.times_stuck;
    w.next_restart_ns = now_ns;
  }
  if (!state.spec.restartable) {
    if (state.given_up) return false;
    state.given_up = true;
    remedy = Remedy::kGiveUp;
    return true;
  }
  if (now_ns < w.next_restart_ns) return false;
  w.next_restart_ns = now_ns + state.spec.limit_ns * (kRestartWait << w.restarts_in_a_row);
  if (w.restarts_in_a_row == kMaxRestarts && !state.given_up) {
    state.given_up = true;
    remedy = Remedy::kGiveUp;
    return true;
  }
  if (w.restarts_in_a_row < kMaxRestarts) ++w.restarts_in_a_row;
  ++state.restarts;
  remedy = Remedy::kRestart;
  return true;
}

}  // namespace fathom::rt
