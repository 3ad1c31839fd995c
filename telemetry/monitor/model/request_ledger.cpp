#include "telemetry/monitor/model/request_ledger.hpp"

#include "realtime/kernel/text.hpp"
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
    // Ids come again after sixteen requests: the newest is meant.
    if (entry.request.id != downlink.content.request->id) continue;
    if (entry.state == State::kQueued) {
      entry.state = State::kSent;
      entry.sent_utc_ns = entry.utc_ns = utc_ns;
    }
    ++entry.times_sent;
    return;
  }
}

std::optional<std::uint8_t> RequestLedger::noteStatus(std::int64_t pose_utc_ns, std::int64_t utc_ns) {
  for (Entry& entry : entries_) {
    if (entry.state != State::kSent || entry.request.kind != Request::Kind::kSendStatus ||
        pose_utc_ns < entry.sent_utc_ns)
      continue;
    entry.state = State::kAnswered;
    entry.utc_ns = utc_ns;
    return entry.request.id;
  }
  return std::nullopt;
}

std::optional<std::uint8_t> RequestLedger::noteBlock(const telemetry::BlockKey& key, std::int64_t utc_ns) {
  const double spacing = telemetry::spacingOf(key.spacing), size = telemetry::MapBlock::kSide * spacing;
  for (Entry& entry : entries_) {
    const Request& r = entry.request;
    if (entry.state != State::kSent || r.kind != Request::Kind::kDetail || spacing > r.spacing) continue;
    if (key.north * size > r.north_max || (key.north + 1) * size < r.north_min ||
        key.east * size > r.east_max || (key.east + 1) * size < r.east_min)
      continue;
    entry.state = State::kAnswered;
    entry.utc_ns = utc_ns;
    return r.id;
  }
  return std::nullopt;
}

const char* name(RequestLedger::State state) {
  switch (state) {
    case RequestLedger::State::kQueued:
      return "queued";
    case RequestLedger::State::kSent:
      return "sent";
    case RequestLedger::State::kAnswered:
      return "answered";
  }
  return "unknown";
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
