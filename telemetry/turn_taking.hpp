#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace fathom::telemetry {

// When the vehicle stops sending to listen, on a link that carries one voice at a time. All in the caller's
// time. Where nobody answers it listens less and less often, up to kMaxBackOff times the interval; a word
// from the ship sets that back.
class TurnTaking {
 public:
  // every_s 0: never listens.
  TurnTaking(double every_s, double listen_s)
      : every_ns_(std::llround(every_s * 1e9)), listen_ns_(std::llround(listen_s * 1e9)) {}

  void setIntervals(double every_s, double listen_s) {
    every_ns_ = std::llround(every_s * 1e9);
    listen_ns_ = std::llround(listen_s * 1e9);
  }
  [[nodiscard]] bool enabled() const { return every_ns_ > 0; }
  // Whether the frame that goes out now, gone at `left_ns`, should be the last before listening. `eager`:
  // nothing else waits, and an acknowledgement would help.
  [[nodiscard]] bool due(std::int64_t left_ns, bool eager) const {
    if (!enabled()) return false;
    const std::int64_t since = left_ns - last_ns_;
    const std::int64_t interval = every_ns_ * backOff();
    return since >= interval || (eager && since >= interval / kEagerShare);
  }
  void begin(std::int64_t left_ns) {
    last_ns_ = left_ns;
    until_ns_ = left_ns + listen_ns_;
    ++unanswered_;
  }
  // A frame has come from the ship: it is the vehicle's turn.
  void heard() {
    until_ns_ = 0;
    unanswered_ = 0;
    ever_ = true;
  }
  [[nodiscard]] bool listening(std::int64_t now_ns) const { return now_ns < until_ns_; }
  // Whether the ship has answered lately: acknowledgements can be relied on.
  [[nodiscard]] bool answered() const { return ever_ && unanswered_ <= kPatience; }
  [[nodiscard]] bool everAnswered() const { return ever_; }

 private:
  static constexpr int kPatience = 5;  // turns without an answer: half of them are lost on a bad day
  static constexpr int kMaxBackOff = 8;
  static constexpr int kEagerShare = 4;
  [[nodiscard]] std::int64_t backOff() const {
    const int over = unanswered_ - kPatience;
    return over <= 0 ? 1 : std::min(over + 1, kMaxBackOff);
  }

  std::int64_t every_ns_, listen_ns_;
  std::int64_t last_ns_ = 0, until_ns_ = 0;
  int unanswered_ = 0;
  bool ever_ = false;
};

}  // namespace fathom::telemetry
