#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <span>
#include <string>

#include "telemetry/downlink/downlink.hpp"
#include "telemetry/wire/report.hpp"

namespace fathom::monitor {

// What became of the requests that the page made, as the vehicle's reports tell. Of a request that was said
// as often as it ever is, and that no report names, there is no answer. Bounded: the oldest are forgotten.
class RequestLedger {
 public:
  enum class State : std::uint8_t { kQueued, kSent, kTaken, kDone, kRefused, kUnanswered };
  struct Entry {
    telemetry::Request request;  // with the id that the sender gave it
    State state = State::kQueued;
    int times_sent = 0;
    std::int64_t utc_ns = 0;  // of the newest change of state
    // Of the frames that said it.
    std::array<telemetry::DownlinkCounter, telemetry::DownlinkSender::kRepetitions> counters{};
  };
  static constexpr std::size_t kMaxEntries = 12;

  void add(const telemetry::Request& request, std::int64_t utc_ns);
  // A downlink frame that left just now: notes the request that it carries, if any.
  void noteSent(std::span<const std::uint8_t> frame, std::int64_t utc_ns);
  // A report that arrived. Calls `confirm` for every request of which the vehicle knows.
  void noteReport(const telemetry::Report& report, std::int64_t utc_ns,
                  const std::function<void(std::uint8_t id)>& confirm);
  // Some time after the last frame: requests that `waits` to be said no more have no answer.
  void noteGivenUp(std::int64_t utc_ns, const std::function<bool(std::uint8_t id)>& waits);

  [[nodiscard]] const std::deque<Entry>& entries() const { return entries_; }  // newest first

 private:
  std::deque<Entry> entries_;
};

[[nodiscard]] const char* name(RequestLedger::State state);
// For people: "detail at 12.5 cm, 10 x 8 m".
[[nodiscard]] std::string describe(const telemetry::Request& request);

}  // namespace fathom::monitor
