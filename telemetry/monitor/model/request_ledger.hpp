#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>

#include "telemetry/map/map_block.hpp"
#include "telemetry/wire/downlink_messages.hpp"

namespace fathom::monitor {

// What became of the requests that the page made. The vehicle confirms nothing in words, so a request counts
// as answered when what it asked for arrives: a status newer than the request, a block of the spacing asked
// for (or finer) inside the rectangle. Rate, pause and resume stay "sent": their effect is seen in the link's
// figures. Bounded: the oldest are forgotten.
class RequestLedger {
 public:
  enum class State : std::uint8_t { kQueued, kSent, kAnswered };
  struct Entry {
    telemetry::Request request;  // with the id that the sender gave it
    State state = State::kQueued;
    int times_sent = 0;
    std::int64_t utc_ns = 0;       // of the newest change of state
    std::int64_t sent_utc_ns = 0;  // when it was first sent
  };
  static constexpr std::size_t kMaxEntries = 12;

  void add(const telemetry::Request& request, std::int64_t utc_ns);
  // A downlink frame that left just now: notes the request that it carries, if any.
  void noteSent(std::span<const std::uint8_t> frame, std::int64_t utc_ns);
  // What arrived at `utc_ns`: a status of a pose at `pose_utc_ns`; a block. Return the id of a request that
  // this answers.
  std::optional<std::uint8_t> noteStatus(std::int64_t pose_utc_ns, std::int64_t utc_ns);
  std::optional<std::uint8_t> noteBlock(const telemetry::BlockKey& key, std::int64_t utc_ns);

  [[nodiscard]] const std::deque<Entry>& entries() const { return entries_; }  // newest first

 private:
  std::deque<Entry> entries_;
};

[[nodiscard]] const char* name(RequestLedger::State state);
// For people: "detail at 12.5 cm, 10 x 8 m".
[[nodiscard]] std::string describe(const telemetry::Request& request);

}  // namespace fathom::monitor
