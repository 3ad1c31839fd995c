#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <span>
#include <string>

#include "realtime/base/units.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::monitor {

// Frames of the link over time, in steps of equal length. Bounded: when the steps are too many, pairs of them
// are joined; after a day without a frame, or a clock step of a day, it starts again.
class LinkHistory {
 public:
  struct Step {
    std::uint64_t bytes = 0;     // of accepted frames
    std::uint64_t accepted = 0;  // frames
    std::uint64_t rejected = 0;  // damaged, foreign or repeated frames
    std::int64_t lost = 0;       // frames; negative when late or repaired ones came after their step
  };
  static constexpr std::size_t kMaxSteps = 720;
  static constexpr std::int64_t kFirstStep_ns = 10'000'000'000;
  static constexpr std::int64_t kLongestSilence_ns = 86'400 * kSecond_ns;

  // Adds a frame received at `utc_ns`; `lost_so_far`: the receiver's count after it.
  void add(std::int64_t utc_ns, std::size_t bytes, bool accepted, std::uint64_t lost_so_far);

  // Over the steps that reach into the `window_s` before the newest.
  struct Recent {
    double rate_bps = 0;  // of accepted frames
    double loss = 0;      // share of the frames sent, 0 to 1; NaN: no frame
  };
  [[nodiscard]] Recent recent(double window_s, std::int64_t now_utc_ns) const;

  [[nodiscard]] std::int64_t start() const { return start_ns_; }  // UTC of the first step [ns]
  [[nodiscard]] std::int64_t step() const { return step_ns_; }    // length of a step [ns]
  [[nodiscard]] const std::deque<Step>& steps() const { return steps_; }

 private:
  std::int64_t start_ns_ = 0, step_ns_ = kFirstStep_ns;
  std::uint64_t lost_ = 0;
  std::deque<Step> steps_;
};

// The states of the page's requests, from the frames sent and the vehicle's reports. A request that was sent
// as often as any and that no report names is unanswered. Bounded: the oldest are dropped.
class RequestLedger {
 public:
  enum class State : std::uint8_t { kQueued, kSent, kTaken, kDone, kRefused, kUnanswered };
  struct Entry {
    telemetry::Request request;  // with the sender's id
    State state = State::kQueued;
    int times_sent = 0;
    std::int64_t utc_ns = 0;  // of the newest change of state
    // Counters of the frames that carried it.
    std::array<telemetry::DownlinkCounter, telemetry::DownlinkSender::kRepetitions> counters{};
  };
  static constexpr std::size_t kMaxEntries = 12;

  void add(const telemetry::Request& request, std::int64_t utc_ns);
  // Notes the request, if any, in a downlink frame that left just now.
  void noteSent(std::span<const std::uint8_t> frame, std::int64_t utc_ns);
  // Notes the outcomes in a received report. Calls `confirm` for every request that the vehicle has.
  void noteReport(const telemetry::StateReport& report, std::int64_t utc_ns,
                  const std::function<void(std::uint8_t id)>& confirm);
  // Marks as unanswered the requests that are not reported and, by `waits`, no longer to be sent.
  void noteGivenUp(std::int64_t utc_ns, const std::function<bool(std::uint8_t id)>& waits);

  [[nodiscard]] const std::deque<Entry>& entries() const { return entries_; }  // newest first

 private:
  std::deque<Entry> entries_;
};

[[nodiscard]] const char* name(RequestLedger::State state);
// For the operator: "detail at 12.5 cm, 10 x 8 m".
[[nodiscard]] std::string describe(const telemetry::Request& request);

}  // namespace fathom::monitor
