#include "telemetry/wire/status.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/units.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::int64_t kTenth_ns = 100'000'000;
constexpr unsigned kOutcomeStateBits = 2;

double headingDegrees(double radians) {
  const double turned = std::fmod(radians / kRadiansPerDegree, 360.0);
  const double degrees = turned < 0 ? turned + 360 : turned;
  return degrees >= schema::kHeading.max + schema::kHeading.resolution / 2 ? 0 : degrees;  // rounds to north
}

double secondsSinceEpoch(std::int64_t utc_ns) {
  return static_cast<double>(utc_ns - schema::kTimeEpoch_s * kSecond_ns) * 1e-9;
}

}  // namespace

const char* healthText(unsigned bit) {
  static constexpr const char* kTexts[kHealthBits] = {
      "soft real time",  "DVL lost",    "compass lost",        "depth lost",    "camera lost",
      "no position fix", "overload",    "pool full",           "map coarsened", "recorder failed",
      "disk low",        "poor stereo", "sensor contradicted", "clock unsure",  "no map"};
  return bit < kHealthBits ? kTexts[bit] : "unknown";
}

std::uint64_t timeToLink(std::int64_t utc_ns) {
  const std::int64_t since = utc_ns - schema::kTimeEpoch_s * kSecond_ns;
  if (since <= 0) return 0;
  return std::min<std::uint64_t>(static_cast<std::uint64_t>((since + kTenth_ns / 2) / kTenth_ns),
                                 schema::kTime.lastCode());
}

std::int64_t timeFromLink(std::uint64_t code) {
  return schema::kTimeEpoch_s * kSecond_ns + static_cast<std::int64_t>(code) * kTenth_ns;
}

std::size_t encodeStatus(const Status& s, std::span<std::uint8_t> out) {
  using namespace schema;
  constexpr unsigned kBits = kStatusTime.bits() + 2 * kStatusHorizontal.bits() + kStatusDepth.bits() +
                             2 * kTilt.bits() + kHeading.bits() + kAltitude.bits() + kSpeed.bits() +
                             kPositionSigma.bits() + kBattery.bits() + kProgress.bits() + kHealthWidth +
                             kArea.bits() + kPairs.bits() + kDropped.bits() + kLateCycles.bits() +
                             kShed.bits() + kRefusals.bits();
  static_assert((kBits + 7) / 8 == kStatusBytes && kHealthBits <= kHealthWidth);
  BitWriter w(out);
  w.put(kStatusTime, secondsSinceEpoch(s.utc_ns));
  w.put(kStatusHorizontal, s.north);
  w.put(kStatusHorizontal, s.east);
  w.put(kStatusDepth, s.depth);
  w.put(kTilt, s.roll / kRadiansPerDegree);
  w.put(kTilt, s.pitch / kRadiansPerDegree);
  w.put(kHeading, headingDegrees(s.heading));
  w.put(kAltitude, s.altitude);
  w.put(kSpeed, s.speed);
  w.put(kPositionSigma, s.position_sigma);
  w.put(kBattery, s.battery);
  w.put(kProgress, s.mission_progress);
  w.put(s.health & ((1U << kHealthBits) - 1), kHealthWidth);
  w.put(kArea, s.map_area);
  w.put(kPairs, s.pairs_seen);
  w.put(kDropped, s.pairs_dropped);
  w.put(kLateCycles, s.late_cycles);
  w.put(kShed, s.shed_work);
  w.put(kRefusals, s.pool_refusals);
  return w.ok() ? w.bytes() : 0;
}

bool decodeStatus(std::span<const std::uint8_t> payload, Status& status) {
  using namespace schema;
  Status s;
  BitReader r(payload);
  s.utc_ns = kTimeEpoch_s * kSecond_ns + rt::nanoseconds(r.get(kStatusTime));
  s.north = r.get(kStatusHorizontal);
  s.east = r.get(kStatusHorizontal);
  s.depth = r.get(kStatusDepth);
  s.roll = r.get(kTilt) * kRadiansPerDegree;
  s.pitch = r.get(kTilt) * kRadiansPerDegree;
  s.heading = r.get(kHeading) * kRadiansPerDegree;
  s.altitude = r.get(kAltitude);
  s.speed = r.get(kSpeed);
  s.position_sigma = r.get(kPositionSigma);
  s.battery = r.get(kBattery);
  s.mission_progress = r.get(kProgress);
  s.health = static_cast<std::uint16_t>(r.get(kHealthWidth));
  const auto count = [&](const LogField& field) { return static_cast<std::uint32_t>(r.get(field) + 0.5); };
  s.map_area = r.get(kArea);
  s.pairs_seen = count(kPairs);
  s.pairs_dropped = count(kDropped);
  s.late_cycles = count(kLateCycles);
  s.shed_work = count(kShed);
  s.pool_refusals = count(kRefusals);
  if (!r.ok() || !r.finished()) return false;
  status = s;
  return true;
}

std::size_t encodeStateReport(const StateReport& report, std::span<std::uint8_t> out) {
  BitWriter w(out);
  w.put(report.health & ((1U << kHealthBits) - 1), schema::kHealthWidth);
  w.put(report.paused ? 1 : 0, 1);
  w.put(schema::kRequestRate, report.rate_bps);
  for (const RequestOutcome& r : report.requests) {
    w.put(static_cast<std::uint64_t>(r.state), kOutcomeStateBits);
    w.put(r.id, schema::kRequestId.bits());
    w.put(r.counter & ((1U << kOutcomeCounterBits) - 1), kOutcomeCounterBits);
  }
  while (w.ok() && w.bytes() < kStateReportBytes) w.put(0, 1);
  return w.ok() ? w.bytes() : 0;
}

bool decodeStateReport(std::span<const std::uint8_t> payload, StateReport& report) {
  if (payload.size() != kStateReportBytes) return false;
  StateReport got;
  BitReader r(payload);
  got.health = static_cast<std::uint16_t>(r.get(schema::kHealthWidth));
  got.paused = r.get(1) != 0;
  got.rate_bps = r.get(schema::kRequestRate);
  for (RequestOutcome& request : got.requests) {
    request.state = static_cast<RequestOutcome::State>(r.get(kOutcomeStateBits));
    request.id = static_cast<std::uint8_t>(r.get(schema::kRequestId.bits()));
    request.counter = static_cast<DownlinkCounter>(r.get(kOutcomeCounterBits));
  }
  if (!r.ok() || !r.finished()) return false;
  report = got;
  return true;
}

}  // namespace fathom::telemetry
