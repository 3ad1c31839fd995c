#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "realtime/base/units.hpp"

namespace fathom::telemetry {

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

}  // namespace fathom::telemetry
