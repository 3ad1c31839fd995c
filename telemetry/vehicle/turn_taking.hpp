#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "realtime/base/units.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::telemetry {

// Limits a rate: over any window of W seconds at most rate * W + capacity bits are taken. Whole numbers, so
// that the same calls give the same answers everywhere. One unit of credit is 1e-12 bit (millibits per second
// times ns).
class TokenBucket {
 public:
  // `rate_bps` 10 to 1e6 bit/s, capacities up to 4 Mbit: all products stay inside 63 bits.
  TokenBucket(double rate_bps, std::size_t capacity_bits, std::size_t initial_bits)
      : rate_(std::llround(rate_bps * 1000)),
        capacity_(static_cast<std::int64_t>(capacity_bits) * kUnitsPerBit),
        credit_(static_cast<std::int64_t>(initial_bits) * kUnitsPerBit) {}

  void advance(std::int64_t now_ns) {
    if (started_ && now_ns > last_ns_) {
      const std::int64_t until_full = (capacity_ - credit_) / rate_ + 1;
      credit_ = std::min(capacity_, credit_ + std::min(now_ns - last_ns_, until_full) * rate_);
    }
    last_ns_ = started_ ? std::max(last_ns_, now_ns) : now_ns;
    started_ = true;
  }
  [[nodiscard]] bool has(std::size_t bits) const {
    return credit_ >= static_cast<std::int64_t>(bits) * kUnitsPerBit;
  }
  void take(std::size_t bits) { credit_ -= static_cast<std::int64_t>(bits) * kUnitsPerBit; }

  // For saved state (state_archive.hpp), bit by bit, into one of the same rate and capacity.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.instants(self.last_ns_);
    archive(self.credit_, self.started_);
    archive.require(self.credit_ <= self.capacity_ && self.credit_ >= -self.capacity_,
                    "credit that cannot be");
  }

 private:
  static constexpr std::int64_t kUnitsPerBit = 1'000'000'000'000;
  std::int64_t rate_;  // [millibit/s]
  std::int64_t capacity_;
  std::int64_t credit_;
  std::int64_t last_ns_ = 0;
  bool started_ = false;
};

// Decides when the vehicle stops sending to listen, on a half-duplex link. All times are the caller's; a
// caller behind the clock reports with left() when a turn really left. After a turn without an answer the
// next comes sooner: the turn or the answer was lost. Without answers for long the vehicle listens less
// often, up to kMaxBackOff times the interval, until a frame from the ship resets that. It listens no longer
// than the ship has lately needed to answer.
class TurnTaking {
 public:
  // every_s 0: never listens. `listen_s`: the longest that an answer may take.
  TurnTaking(double every_s, double listen_s) { setIntervals(every_s, listen_s); }
  void setIntervals(double every_s, double listen_s) {
    every_ns_ = rt::nanoseconds(every_s);
    listen_ns_ = longest_ns_ = rt::nanoseconds(listen_s);
  }
  [[nodiscard]] bool enabled() const { return every_ns_ > 0; }
  // Whether the frame that goes out now, gone at `left_ns`, should be the last before listening. `eager`:
  // nothing else waits, and an acknowledgement would help.
  [[nodiscard]] bool due(std::int64_t left_ns, bool eager) const {
    if (!enabled()) return false;
    const std::int64_t since = left_ns - last_ns_;
    return since >= interval() || (eager && since >= kEagerTurns * listen_ns_);
  }
  // `now_ns`: the frame with the turn goes to the modem, by the caller's time; gone at `left_ns`.
  void begin(std::int64_t now_ns, std::int64_t left_ns) {
    // The answer was missed, or the ship needs longer now.
    if (unanswered_ > 0) listen_ns_ = std::min(longest_ns_, listen_ns_ + listen_ns_ / 8);
    given_ns_ = now_ns;
    last_ns_ = left_ns;
    until_ns_ = left_ns + listen_ns_;
    awaits_departure_ = departures_known_;
    ++unanswered_;
  }
  // The frame with the turn is given to the modem only at `now_ns`: the caller is behind by the difference.
  void left(std::int64_t now_ns) {
    departures_known_ = true;
    if (until_ns_ == 0 || given_ns_ == 0) return;
    const std::int64_t late_ns = std::clamp<std::int64_t>(now_ns - given_ns_, 0, kLongestLag_ns);
    last_ns_ += late_ns;
    until_ns_ += late_ns;
    given_ns_ = 0;
    awaits_departure_ = false;
  }
  // A frame has come from the ship: the vehicle's turn begins.
  void received(std::int64_t now_ns) {
    if (listening(now_ns)) {
      const std::int64_t needed = now_ns - last_ns_ + kMargin_ns;
      listen_ns_ = std::min(longest_ns_, std::max(needed, listen_ns_ - listen_ns_ / 8));
    }
    until_ns_ = 0;
    awaits_departure_ = false;
    unanswered_ = 0;
    ever_ = true;
  }
  [[nodiscard]] bool listening(std::int64_t now_ns) const {
    return now_ns < until_ns_ + (awaits_departure_ ? kLongestLag_ns : 0);
  }
  // Whether the ship has answered lately, so that acknowledgements can be expected.
  [[nodiscard]] bool answered() const { return ever_ && unanswered_ <= kPatience; }
  [[nodiscard]] bool everAnswered() const { return ever_; }

  // For saved state (state_archive.hpp), bit by bit; the intervals are the caller's.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.instants(self.last_ns_, self.until_ns_, self.given_ns_);
    archive(self.listen_ns_, self.unanswered_, self.ever_, self.departures_known_, self.awaits_departure_);
    archive.require(self.listen_ns_ >= 0 && self.listen_ns_ <= self.longest_ns_ && self.unanswered_ >= 0,
                    "turns that cannot be");
  }

 private:
  static constexpr int kPatience = 6;  // turns without an answer: on a bad link half of them are lost
  static constexpr int kMaxBackOff = 8;
  static constexpr int kEagerTurns = 2;  // at most a third of the time, where nothing else is to be sent
  static constexpr std::int64_t kMargin_ns = 300'000'000;
  static constexpr std::int64_t kLongestLag_ns = 10'000'000'000;
  [[nodiscard]] std::int64_t interval() const {
    if (unanswered_ == 0) return every_ns_;
    if (unanswered_ <= kPatience && ever_) return every_ns_ / 2;
    return every_ns_ * std::clamp(unanswered_ - kPatience, 1, kMaxBackOff);
  }

  std::int64_t every_ns_ = 0, listen_ns_ = 0, longest_ns_ = 0;
  std::int64_t last_ns_ = 0, until_ns_ = 0;
  std::int64_t given_ns_ = 0;  // of the turn whose leaving is not known yet; 0: none
  bool departures_known_ = false,
       awaits_departure_ = false;  // the caller reports when turns leave; and will of this one
  int unanswered_ = 0;
  bool ever_ = false;
};

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
