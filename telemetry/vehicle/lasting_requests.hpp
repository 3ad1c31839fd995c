#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "realtime/base/units.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/status.hpp"

namespace fathom::telemetry {

// The requests of the ship that last (pause, rate), and the outcome of every request. After kLongestSilence_s
// without a frame from the ship a pause ends and the configured rate holds again; the rate also when the ship
// has acknowledged no frame sent at the requested rate for as long. The state survives a restart, and the
// report carries it.
class LastingRequests {
 public:
  static constexpr double kLongestSilence_s = 600;

  explicit LastingRequests(double configured_rate_bps) : configured_bps_(configured_rate_bps) {}

  [[nodiscard]] bool paused() const { return paused_; }
  [[nodiscard]] const std::array<RequestOutcome, 6>& outcomes() const { return outcomes_; }

  void received(std::int64_t now_ns) { received_ns_ = now_ns; }
  void pause(bool paused) { paused_ = paused; }
  // The ship has requested a rate; `next`: the first frame sent at it.
  void rateAsked(Version next, std::int64_t now_ns);
  void acknowledged(Version newest);
  // Adds a received request's outcome, in place of an earlier one of its id or of the one done longest.
  void note(const RequestOutcome& outcome);
  // Sets the state of a request that is still listed.
  void become(const RequestOutcome& outcome);
  // Ends requests that have lasted too long; returns the configured rate when it holds again.
  [[nodiscard]] std::optional<double> lapse(std::int64_t now_ns);

  // For saved state (state_archive.hpp), bit by bit, into one of the same configuration.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.paused_, self.asked_, self.proven_, self.first_at_rate_);
    archive.instants(self.received_ns_, self.asked_ns_);
    for (auto& o : self.outcomes_) {
      archive.enumeration(o.state, RequestOutcome::State::kRefused);
      archive(o.id, o.counter);
      archive.require(o.id <= schema::kRequestId.max, "a request that cannot be");
    }
  }

 private:
  double configured_bps_;
  bool paused_ = false;
  bool asked_ = false;         // another rate than the configured one holds
  bool proven_ = false;        // a frame sent at it was acknowledged
  Version first_at_rate_ = 0;  // frame
  std::int64_t received_ns_ = 0, asked_ns_ = 0;
  std::array<RequestOutcome, 6> outcomes_{};  // newest first
};

inline void LastingRequests::rateAsked(Version next, std::int64_t now_ns) {
  asked_ = true;
  proven_ = false;
  first_at_rate_ = next;
  asked_ns_ = now_ns;
}

inline void LastingRequests::acknowledged(Version newest) {
  proven_ = proven_ || newest >= first_at_rate_;
}

inline void LastingRequests::note(const RequestOutcome& outcome) {
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

inline void LastingRequests::become(const RequestOutcome& outcome) {
  for (RequestOutcome& o : outcomes_)
    if (o.state != RequestOutcome::State::kNone && o.id == outcome.id && o.counter == outcome.counter)
      o.state = outcome.state;
}

inline std::optional<double> LastingRequests::lapse(std::int64_t now_ns) {
  const auto longAgo = [now_ns](std::int64_t then_ns) {
    return static_cast<double>(now_ns - then_ns) >= kLongestSilence_s * 1e9;
  };
  const bool silent = longAgo(received_ns_);
  if (silent) paused_ = false;
  if (!asked_ || !(silent || (!proven_ && longAgo(asked_ns_)))) return std::nullopt;
  asked_ = false;
  return configured_bps_;
}

}  // namespace fathom::telemetry
