#include "telemetry/wire/uplink_messages.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "realtime/base/units.hpp"
#include "telemetry/map/map_packet.hpp"

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

// Payload: u6 number of points, u5 width of the differences, the newest point in full (time, north, east,
// depth as codes of the status schema), then per older point u10 time difference [0.1 s] and three signed
// differences of codes.
constexpr unsigned kCountBits = 6;
constexpr unsigned kWidthBits = 5;
constexpr unsigned kStepBits = 10;  // up to 102.3 s between points
static_assert(kMaxTrackPoints < 1U << kCountBits);

struct Codes {
  std::int64_t time, north, east, depth;
};

Codes toCodes(const TrackPoint& p) {
  return {static_cast<std::int64_t>(timeToLink(p.utc_ns)),
          static_cast<std::int64_t>(schema::kHorizontal.encode(p.north)),
          static_cast<std::int64_t>(schema::kHorizontal.encode(p.east)),
          static_cast<std::int64_t>(schema::kDepth.encode(p.depth))};
}

unsigned signedWidth(std::int64_t value) {
  const std::uint64_t magnitude = static_cast<std::uint64_t>(value < 0 ? ~value : value);
  unsigned bits = 1;
  while (bits < 64 && magnitude >> (bits - 1) != 0) ++bits;
  return bits;
}

std::size_t headBits() {
  return kCountBits + kWidthBits + schema::kTime.bits() + 2 * schema::kHorizontal.bits() +
         schema::kDepth.bits();
}

bool codeValid(std::int64_t code, const Field& field) {
  return code >= 0 && static_cast<std::uint64_t>(code) <= field.lastCode();
}

bool valid(const Codes& c) {
  return codeValid(c.time, schema::kTime) && codeValid(c.north, schema::kHorizontal) &&
         codeValid(c.east, schema::kHorizontal) && codeValid(c.depth, schema::kDepth);
}

constexpr Field kLatitude{-90, 90, 1e-7};     // [deg]
constexpr Field kLongitude{-180, 180, 1e-7};  // [deg]
constexpr unsigned kHashBits = 16;
constexpr unsigned kLengthBits = 5;
constexpr unsigned kCharacterBits = 7;  // ASCII
static_assert(kMaxNameBytes < 1U << kLengthBits);

constexpr bool printable(char c) {
  return c >= ' ' && c <= '~';
}

constexpr std::uint32_t hashSchema() {
  std::uint32_t hash = 2166136261U;  // FNV offset basis
  using namespace schema;
  for (const Field& field : {kTime, kHorizontal, kDepth, kStatusTime, kStatusHorizontal, kStatusDepth, kTilt,
                             kHeading, kAltitude, kSpeed, kBattery, kProgress, kLatitude, kLongitude})
    hash = hashField(hash, field);
  for (const LogField& field : {kPositionSigma, kArea, kPairs, kDropped, kLateCycles, kShed, kRefusals})
    hash = hashField(hash, field);
  return (hash ^ kMapPacketFormat) * 16777619U;  // FNV prime
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

std::size_t encodeTrack(std::span<const TrackPoint> points, std::span<std::uint8_t> out) {
  if (points.empty() || out.size() * 8 < headBits()) return 0;
  // Each further point may widen all differences; take points while the whole still fits.
  std::array<Codes, kMaxTrackPoints> codes{};
  std::size_t count = 1;
  unsigned width = 1;
  codes[0] = toCodes(points.back());
  while (count < std::min(points.size(), kMaxTrackPoints)) {
    const Codes next = toCodes(points[points.size() - 1 - count]);
    const Codes& last = codes[count - 1];
    const std::int64_t step = last.time - next.time;
    if (step <= 0 || step >= 1 << kStepBits) break;
    const unsigned wider =
        std::max({width, signedWidth(last.north - next.north), signedWidth(last.east - next.east),
                  signedWidth(last.depth - next.depth)});
    if (headBits() + count * (kStepBits + 3 * wider) > out.size() * 8) break;
    width = wider;
    codes[count++] = next;
  }
  BitWriter w(out);
  w.put(count, kCountBits);
  w.put(width, kWidthBits);
  w.put(static_cast<std::uint64_t>(codes[0].time), schema::kTime.bits());
  w.put(static_cast<std::uint64_t>(codes[0].north), schema::kHorizontal.bits());
  w.put(static_cast<std::uint64_t>(codes[0].east), schema::kHorizontal.bits());
  w.put(static_cast<std::uint64_t>(codes[0].depth), schema::kDepth.bits());
  for (std::size_t i = 1; i < count; ++i) {
    w.put(static_cast<std::uint64_t>(codes[i - 1].time - codes[i].time), kStepBits);
    w.putSigned(codes[i - 1].north - codes[i].north, width);
    w.putSigned(codes[i - 1].east - codes[i].east, width);
    w.putSigned(codes[i - 1].depth - codes[i].depth, width);
  }
  return w.ok() ? w.bytes() : 0;
}

std::size_t decodeTrack(std::span<const std::uint8_t> payload, std::span<TrackPoint> out) {
  BitReader r(payload);
  const std::size_t count = r.get(kCountBits);
  const unsigned width = static_cast<unsigned>(r.get(kWidthBits));
  if (!r.ok() || count == 0 || count > out.size() || width == 0) return 0;
  Codes code{static_cast<std::int64_t>(r.get(schema::kTime.bits())),
             static_cast<std::int64_t>(r.get(schema::kHorizontal.bits())),
             static_cast<std::int64_t>(r.get(schema::kHorizontal.bits())),
             static_cast<std::int64_t>(r.get(schema::kDepth.bits()))};
  for (std::size_t i = 0; i < count; ++i) {
    if (i > 0) {
      const auto step = static_cast<std::int64_t>(r.get(kStepBits));
      if (step == 0) return 0;
      code.time -= step;
      code.north -= r.getSigned(width);
      code.east -= r.getSigned(width);
      code.depth -= r.getSigned(width);
    }
    if (!r.ok() || !valid(code)) return 0;
    out[count - 1 - i] = {timeFromLink(static_cast<std::uint64_t>(code.time)),
                          schema::kHorizontal.decode(static_cast<std::uint64_t>(code.north)),
                          schema::kHorizontal.decode(static_cast<std::uint64_t>(code.east)),
                          schema::kDepth.decode(static_cast<std::uint64_t>(code.depth))};
  }
  return r.finished() ? count : 0;
}

std::uint16_t schemaHash() {
  constexpr std::uint32_t kHash = hashSchema();
  return static_cast<std::uint16_t>(kHash ^ kHash >> 16);
}

std::size_t encodeMissionInfo(const MissionInfo& info, std::span<std::uint8_t> out) {
  BitWriter w(out);
  w.put(schemaHash(), kHashBits);
  w.put(kLatitude, info.origin.latitude / kRadiansPerDegree);
  w.put(kLongitude, info.origin.longitude / kRadiansPerDegree);
  w.put(timeToLink(info.start_utc_ns), schema::kTime.bits());
  if (!w.ok() || w.bitsLeft() < kLengthBits) return 0;
  const std::size_t room = (w.bitsLeft() - kLengthBits) / kCharacterBits;
  const std::size_t length = std::min({info.vehicle_name.size(), kMaxNameBytes, room});
  w.put(length, kLengthBits);
  for (std::size_t i = 0; i < length; ++i) {
    const char c = info.vehicle_name[i];
    w.put(static_cast<std::uint64_t>(printable(c) ? c : '?'), kCharacterBits);
  }
  return w.ok() ? w.bytes() : 0;
}

bool decodeMissionInfo(std::span<const std::uint8_t> payload, MissionInfo& info) {
  MissionInfo decoded;
  BitReader r(payload);
  decoded.schema_hash = static_cast<std::uint16_t>(r.get(kHashBits));
  decoded.origin.latitude = r.get(kLatitude) * kRadiansPerDegree;
  decoded.origin.longitude = r.get(kLongitude) * kRadiansPerDegree;
  decoded.start_utc_ns = timeFromLink(r.get(schema::kTime.bits()));
  const std::size_t length = r.get(kLengthBits);
  for (std::size_t i = 0; i < length && r.ok(); ++i) {
    const char c = static_cast<char>(r.get(kCharacterBits));
    if (!printable(c)) return false;
    decoded.vehicle_name.push_back(c);
  }
  if (!r.ok() || !r.finished()) return false;
  info = decoded;
  return true;
}

}  // namespace fathom::telemetry
