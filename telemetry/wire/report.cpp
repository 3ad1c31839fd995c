#include "telemetry/wire/report.hpp"

#include "telemetry/wire/status.hpp"

namespace fathom::telemetry {
namespace {

constexpr unsigned kStateBits = 2;

}  // namespace

std::size_t encodeReport(const Report& report, std::span<std::uint8_t> out) {
  BitWriter w(out);
  w.put(report.health & ((1U << kHealthBits) - 1), schema::kHealthWidth);
  w.put(report.paused ? 1 : 0, 1);
  w.put(schema::kRequestRate, report.rate_bps);
  for (const RequestOutcome& r : report.requests) {
    w.put(static_cast<std::uint64_t>(r.state), kStateBits);
    w.put(r.id, schema::kRequestId.bits());
    w.put(r.counter & ((1U << kOutcomeCounterBits) - 1), kOutcomeCounterBits);
  }
  while (w.ok() && w.bytes() < kReportBytes) w.put(0, 1);
  return w.ok() ? w.bytes() : 0;
}

bool decodeReport(std::span<const std::uint8_t> payload, Report& report) {
  if (payload.size() != kReportBytes) return false;
  Report got;
  BitReader r(payload);
  got.health = static_cast<std::uint16_t>(r.get(schema::kHealthWidth));
  got.paused = r.get(1) != 0;
  got.rate_bps = r.get(schema::kRequestRate);
  for (RequestOutcome& request : got.requests) {
    request.state = static_cast<RequestOutcome::State>(r.get(kStateBits));
    request.id = static_cast<std::uint8_t>(r.get(schema::kRequestId.bits()));
    request.counter = static_cast<DownlinkCounter>(r.get(kOutcomeCounterBits));
  }
  if (!r.ok() || !r.finished()) return false;
  report = got;
  return true;
}

}  // namespace fathom::telemetry
