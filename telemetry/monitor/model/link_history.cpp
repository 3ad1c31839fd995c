#include "telemetry/monitor/model/link_history.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "realtime/base/text.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/link_key.hpp"

namespace fathom::monitor {

using telemetry::Request;

void LinkHistory::add(std::int64_t utc_ns, std::size_t bytes, bool accepted, std::uint64_t lost_so_far) {
  // A clock that started in another year, or a day without a frame: the steps before are dropped.
  const auto length_ns = static_cast<std::int64_t>(steps_.size()) * step_ns_;
  if (!steps_.empty() &&
      (utc_ns - start_ns_ - length_ns > kLongestSilence_ns || start_ns_ - utc_ns > kLongestSilence_ns)) {
    steps_.clear();
    step_ns_ = kFirstStep_ns;
  }
  if (steps_.empty()) start_ns_ = utc_ns - utc_ns % kFirstStep_ns;
  // A clock that was set back adds to the newest step.
  std::int64_t index = utc_ns < start_ns_ ? 0 : (utc_ns - start_ns_) / step_ns_;
  while (index >= static_cast<std::int64_t>(kMaxSteps)) {
    for (std::size_t i = 0; 2 * i < steps_.size(); ++i) {
      Step sum = steps_[2 * i];
      if (2 * i + 1 < steps_.size()) {
        const Step& second = steps_[2 * i + 1];
        sum.bytes += second.bytes;
        sum.accepted += second.accepted;
        sum.rejected += second.rejected;
        sum.lost += second.lost;
      }
      steps_[i] = sum;
    }
    steps_.resize((steps_.size() + 1) / 2);
    step_ns_ *= 2;
    index /= 2;
  }
  const auto at = static_cast<std::size_t>(index);
  if (at >= steps_.size()) steps_.resize(at + 1);
  Step& step = steps_.size() > at + 1 ? steps_.back() : steps_[at];
  step.lost += static_cast<std::int64_t>(lost_so_far) - static_cast<std::int64_t>(lost_);
  lost_ = lost_so_far;
  if (accepted) {
    step.bytes += bytes;
    ++step.accepted;
  } else {
    ++step.rejected;
  }
}

LinkHistory::Recent LinkHistory::recent(double window_s, std::int64_t now_utc_ns) const {
  const auto from = now_utc_ns - static_cast<std::int64_t>(window_s * 1e9);
  double bits = 0, accepted = 0, lost = 0;
  std::int64_t begin = now_utc_ns;
  for (std::size_t i = steps_.size(); i-- > 0;) {
    const std::int64_t at = start_ns_ + static_cast<std::int64_t>(i) * step_ns_;
    if (at + step_ns_ <= from) break;
    begin = at;
    bits += 8.0 * static_cast<double>(steps_[i].bytes);
    accepted += static_cast<double>(steps_[i].accepted);
    lost += static_cast<double>(steps_[i].lost);
  }
  const double span = std::max(window_s, static_cast<double>(now_utc_ns - begin) * 1e-9);
  lost = std::max(lost, 0.0);
  return {bits / span, accepted + lost > 0 ? lost / (accepted + lost) : std::nan("")};
}

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
