#include "telemetry/monitor/request_ledger.hpp"

#include <array>
#include <cstdio>

#include "telemetry/downlink_key.hpp"
#include "telemetry/frame.hpp"

namespace fathom::monitor {

using telemetry::Request;

void RequestLedger::add(const Request& request, std::int64_t utc_ns) {
  entries_.push_front({request, State::kQueued, 0, utc_ns});
  if (entries_.size() > kMaxEntries) entries_.pop_back();
}

void RequestLedger::noteSent(std::span<const std::uint8_t> frame, std::int64_t utc_ns) {
  const auto decoded = telemetry::decodeFrame(frame);
  constexpr std::size_t kSignature = telemetry::DownlinkKey::kSignatureBytes;
  if (decoded.verdict != telemetry::FrameVerdict::kAccepted || decoded.payload.size() < kSignature) return;
  telemetry::DecodedDownlink downlink;
  if (!telemetry::decodeDownlink(decoded.payload.first(decoded.payload.size() - kSignature), downlink) ||
      !downlink.content.request)
    return;
  for (Entry& entry : entries_) {
    // Ids come again after sixteen requests: the newest is meant.
    if (entry.request.id != downlink.content.request->id) continue;
    if (entry.state == State::kQueued) entry.state = State::kSent;
    if (entry.state == State::kSent) entry.utc_ns = utc_ns;
    ++entry.times_sent;
    return;
  }
}

void RequestLedger::noteDone(std::uint8_t id, std::int64_t utc_ns) {
  for (Entry& entry : entries_) {
    if (entry.request.id != id) continue;
    if (entry.state == State::kSent) {
      entry.state = State::kAcknowledged;
      entry.utc_ns = utc_ns;
    }
    return;
  }
}

const char* name(RequestLedger::State state) {
  switch (state) {
    case RequestLedger::State::kQueued:
      return "queued";
    case RequestLedger::State::kSent:
      return "sent";
    case RequestLedger::State::kAcknowledged:
      return "acknowledged";
  }
  return "unknown";
}

std::string describe(const Request& request) {
  std::array<char, 80> text{};
  switch (request.kind) {
    case Request::Kind::kDetail:
      std::snprintf(text.data(), text.size(), "detail at %.3g cm, %.1f x %.1f m", request.spacing * 100,
                    request.north_max - request.north_min, request.east_max - request.east_min);
      break;
    case Request::Kind::kRate:
      std::snprintf(text.data(), text.size(), "rate %.0f bit/s", request.rate_bps);
      break;
    case Request::Kind::kPauseMap:
      return "pause the map";
    case Request::Kind::kResumeMap:
      return "resume the map";
    case Request::Kind::kSendStatus:
      return "send a status";
  }
  return text.data();
}

}  // namespace fathom::monitor
