#include "telemetry/monitor/model/request_ledger.hpp"

#include <algorithm>
#include <array>

#include "realtime/base/text.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/link_key.hpp"

namespace fathom::monitor {

using telemetry::Request;

void RequestLedger::add(const Request& request, std::int64_t utc_ns) {
  entries_.push_front({request, State::kQueued, 0, utc_ns});
  if (entries_.size() > kMaxEntries) entries_.pop_back();
}

void RequestLedger::noteSent(std::span<const std::uint8_t> frame, std::int64_t utc_ns) {
  const auto decoded = telemetry::decodeFrame(frame);
  constexpr std::size_t kSignature = telemetry::LinkKey::kSignatureBytes;
  if (decoded.verdict != telemetry::FrameVerdict::kAccepted || decoded.payload.size() < kSignature) return;
  telemetry::DecodedDownlink downlink;
  if (!telemetry::decodeDownlink(decoded.payload.first(decoded.payload.size() - kSignature), downlink) ||
      !downlink.content.request)
    return;
  for (Entry& entry : entries_) {
    // Ids repeat after sixteen requests: the newest one matches.
    if (entry.request.id != downlink.content.request->id) continue;
    if (entry.state == State::kQueued) {
      entry.state = State::kSent;
      entry.utc_ns = utc_ns;
    }
    entry.counters[static_cast<std::size_t>(entry.times_sent++) % entry.counters.size()] = downlink.counter;
    return;
  }
}

void RequestLedger::noteReport(const telemetry::StateReport& report, std::int64_t utc_ns,
                               const std::function<void(std::uint8_t id)>& confirm) {
  using Outcome = telemetry::RequestOutcome;
  constexpr telemetry::DownlinkCounter kCounterMask = (1U << telemetry::kOutcomeCounterBits) - 1;
  for (Entry& entry : entries_) {
    const auto said = std::span(entry.counters)
                          .first(std::min(entry.counters.size(), static_cast<std::size_t>(entry.times_sent)));
    for (const Outcome& outcome : report.requests) {
      const auto is = [&](telemetry::DownlinkCounter counter) {
        return (counter & kCounterMask) == outcome.counter;
      };
      if (outcome.state == Outcome::State::kNone || outcome.id != entry.request.id ||
          std::none_of(said.begin(), said.end(), is))
        continue;
      const State state = outcome.state == Outcome::State::kDone      ? State::kDone
                          : outcome.state == Outcome::State::kRefused ? State::kRefused
                                                                      : State::kTaken;
      if (state != entry.state) entry.utc_ns = utc_ns;
      entry.state = state;
      confirm(outcome.id);
    }
  }
}

void RequestLedger::noteGivenUp(std::int64_t utc_ns, const std::function<bool(std::uint8_t id)>& waits) {
  for (Entry& entry : entries_) {
    if ((entry.state != State::kSent && entry.state != State::kQueued) || waits(entry.request.id)) continue;
    entry.state = State::kUnanswered;
    entry.utc_ns = utc_ns;
  }
}

const char* name(RequestLedger::State state) {
  static constexpr std::array kNames{"queued", "sent", "taken", "done", "refused", "no answer"};
  const auto at = static_cast<std::size_t>(state);
  return at < kNames.size() ? kNames[at] : "unknown";
}

std::string describe(const Request& request) {
  switch (request.kind) {
    case Request::Kind::kDetail:
      return formatted("detail at %.3g cm, %.1f x %.1f m", request.spacing * 100,
                       request.north_max - request.north_min, request.east_max - request.east_min);
    case Request::Kind::kRate:
      return formatted("rate %.0f bit/s", request.rate_bps);
    case Request::Kind::kPauseMap:
      return "pause the map";
    case Request::Kind::kResumeMap:
      return "resume the map";
    case Request::Kind::kSendStatus:
      return "send a status";
  }
  return "unknown";
}

}  // namespace fathom::monitor
