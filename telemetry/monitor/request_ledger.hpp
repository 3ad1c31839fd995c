#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <string>

#include "telemetry/downlink_messages.hpp"

namespace fathom::monitor {

// What became of the requests that the page made. Bounded: the oldest are forgotten.
class RequestLedger {
 public:
  enum class State : std::uint8_t { kQueued, kSent, kAcknowledged };
  struct Entry {
    telemetry::Request request;  // with the id that the sender gave it
    State state = State::kQueued;
    int times_sent = 0;
    std::int64_t utc_ns = 0;  // of the newest change of state
  };
  static constexpr std::size_t kMaxEntries = 12;

  void add(const telemetry::Request& request, std::int64_t utc_ns);
  // A downlink frame that left just now: notes the request that it carries, if any.
  void noteSent(std::span<const std::uint8_t> frame, std::int64_t utc_ns);
  // The vehicle has done it.
  void noteDone(std::uint8_t id, std::int64_t utc_ns);

  [[nodiscard]] const std::deque<Entry>& entries() const { return entries_; }  // newest first

 private:
  std::deque<Entry> entries_;
};

[[nodiscard]] const char* name(RequestLedger::State state);
// For people: "detail at 12.5 cm, 10 x 8 m".
[[nodiscard]] std::string describe(const telemetry::Request& request);

}  // namespace fathom::monitor
