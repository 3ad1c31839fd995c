#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <span>
#include <string>

#include "telemetry/downlink/downlink.hpp"
#include "telemetry/wire/status.hpp"

namespace fathom::monitor {

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
