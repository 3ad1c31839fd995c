#include "telemetry/vehicle/wishes.hpp"

#include <algorithm>

namespace fathom::telemetry {

void Wishes::rateAsked(Version next, std::int64_t now_ns) {
  asked_ = true;
  proven_ = false;
  first_at_rate_ = next;
  asked_ns_ = now_ns;
}

void Wishes::acknowledged(Version newest) {
  proven_ = proven_ || newest >= first_at_rate_;
}

void Wishes::note(const RequestOutcome& outcome) {
  const auto none = [](const RequestOutcome& o) { return o.state == RequestOutcome::State::kNone; };
  auto at = std::find_if(outcomes_.begin(), outcomes_.end(),
                         [&](const RequestOutcome& o) { return !none(o) && o.id == outcome.id; });
  if (at == outcomes_.end()) at = std::find_if(outcomes_.begin(), outcomes_.end(), none);
  if (at == outcomes_.end()) {
    const auto done = std::find_if(outcomes_.rbegin(), outcomes_.rend(), [](const RequestOutcome& o) {
      return o.state != RequestOutcome::State::kTaken;
    });
    at = done == outcomes_.rend() ? outcomes_.end() - 1 : done.base() - 1;
  }
  std::move_backward(outcomes_.begin(), at, at + 1);
  outcomes_.front() = outcome;
}

void Wishes::become(const RequestOutcome& outcome) {
  for (RequestOutcome& o : outcomes_)
    if (o.state != RequestOutcome::State::kNone && o.id == outcome.id && o.counter == outcome.counter)
      o.state = outcome.state;
}

std::optional<double> Wishes::lapse(std::int64_t now_ns) {
  const auto longAgo = [now_ns](std::int64_t then_ns) {
    return static_cast<double>(now_ns - then_ns) >= kUnheard_s * 1e9;
  };
  const bool unheard = longAgo(heard_ns_);
  if (unheard) paused_ = false;
  if (!asked_ || !(unheard || (!proven_ && longAgo(asked_ns_)))) return std::nullopt;
  asked_ = false;
  return configured_bps_;
}

}  // namespace fathom::telemetry
