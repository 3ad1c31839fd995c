#include "telemetry/wire/downlink_messages.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "realtime/base/units.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::int64_t kTick_ns = kSecond_ns / 10;  // of the counter
constexpr unsigned kCounterBits = 32;
constexpr unsigned kSequenceBits = 16;
constexpr unsigned kByteBits = 8;

// Whether the value encodes without saturating: rounding may carry a decoded bound a little over itself.
bool fits(const Field& field, double value) {
  return value >= field.min - field.resolution / 2 && value <= field.max + field.resolution / 2;
}

double secondsBefore(DownlinkCounter counter, std::int64_t utc_ns) {
  return static_cast<double>(downlinkTime(counter) - utc_ns) / static_cast<double>(kSecond_ns);
}

void put(BitWriter& w, const UsblFixMessage& fix, DownlinkCounter counter) {
  w.put(schema::kFixAge, secondsBefore(counter, fix.utc_ns));
  w.put(schema::kFixLatitude, fix.latitude);
  w.put(schema::kFixLongitude, fix.longitude);
  w.put(schema::kFixDepth, fix.depth);
  w.put(schema::kFixSigma, fix.sigma);
}

UsblFixMessage getFix(BitReader& r, DownlinkCounter counter) {
  constexpr double kAgeStep = 0.01;               // [s], of schema::kFixAge
  constexpr std::int64_t kAgeStep_ns = 10000000;  // the same
  UsblFixMessage fix;
  const double age = r.get(schema::kFixAge);
  fix.utc_ns = downlinkTime(counter);
  if (r.ok()) fix.utc_ns -= static_cast<std::int64_t>(std::lround(age / kAgeStep)) * kAgeStep_ns;
  fix.latitude = r.get(schema::kFixLatitude);
  fix.longitude = r.get(schema::kFixLongitude);
  fix.depth = r.get(schema::kFixDepth);
  fix.sigma = r.get(schema::kFixSigma);
  return fix;
}

void put(BitWriter& w, const Request& request) {
  w.put(schema::kRequestKind, static_cast<double>(request.kind));
  w.put(schema::kRequestId, request.id);
  if (request.kind == Request::Kind::kRate) w.put(schema::kRequestRate, request.rate_bps);
  if (request.kind != Request::Kind::kDetail) return;
  w.put(schema::kDetailCorner, request.north_min);
  w.put(schema::kDetailCorner, request.east_min);
  w.put(schema::kDetailSide, request.north_max - request.north_min);
  w.put(schema::kDetailSide, request.east_max - request.east_min);
  w.put(schema::kDetailSpacing, std::log2(request.spacing));
  w.put(schema::kDetailError, request.max_error);
}

Request getRequest(BitReader& r) {
  Request request;
  request.kind = static_cast<Request::Kind>(r.get(schema::kRequestKind.bits()));
  request.id = static_cast<std::uint8_t>(r.get(schema::kRequestId.bits()));
  if (request.kind == Request::Kind::kRate) request.rate_bps = r.get(schema::kRequestRate);
  if (request.kind != Request::Kind::kDetail) return request;
  request.north_min = r.get(schema::kDetailCorner);
  request.east_min = r.get(schema::kDetailCorner);
  request.north_max = request.north_min + r.get(schema::kDetailSide);
  request.east_max = request.east_min + r.get(schema::kDetailSide);
  request.spacing = std::exp2(r.get(schema::kDetailSpacing));
  request.max_error = r.get(schema::kDetailError);
  return request;
}

void put(BitWriter& w, const Acknowledgement& a) {
  w.put(a.newest, kSequenceBits);
  std::size_t reach = std::min(a.reach, Acknowledgement::kMaxReach);
  // The reader takes every bit up to the end for a frame. An acknowledgement with `lacking` fills its last
  // byte with the first of the frames that lack.
  const std::size_t end = w.bits() + 1 + kSequenceBits + reach;
  const std::size_t filled =
      std::min((kByteBits - end % kByteBits) % kByteBits, Acknowledgement::kMaxReach - reach);
  const bool lacks = a.lacking > filled && w.bitsLeft() >= 1 + kSequenceBits + reach;
  w.put(lacks ? 1 : 0, 1);
  if (lacks) {
    const bool all = a.lacking == Acknowledgement::kAll;
    w.put(all ? a.lacking : static_cast<std::uint64_t>(a.lacking - filled), kSequenceBits);
  } else {
    // Otherwise one that would end inside a byte leaves out its furthest frames; with fewer than a byte of
    // them it is filled with frames not received.
    reach = std::min(reach, w.bitsLeft());
    const std::size_t over = (w.bits() + reach) % kByteBits;
    if (reach < Acknowledgement::kMaxReach && reach >= over) reach -= over;
  }
  for (std::size_t i = 0; i < reach; ++i) w.put(a.before[i] ? 1 : 0, 1);
  while (w.bits() % kByteBits != 0) w.put(0, 1);
}

Acknowledgement getAcknowledgement(BitReader& r) {
  Acknowledgement a;
  a.newest = static_cast<std::uint16_t>(r.get(kSequenceBits));
  const bool lacks = r.get(1) != 0;
  if (lacks) a.lacking = static_cast<std::uint16_t>(r.get(kSequenceBits));
  a.valid = !lacks || a.lacking > 0;
  a.reach = std::min(r.bitsLeft(), Acknowledgement::kMaxReach);
  for (std::size_t i = 0; i < a.reach; ++i) a.before[i] = r.get(1) != 0;
  return a;
}

}  // namespace

const char* name(Request::Kind kind) {
  static constexpr std::array kNames{"detail", "rate", "pause-map", "resume-map", "send-status"};
  const auto at = static_cast<std::size_t>(kind);
  return at < kNames.size() ? kNames[at] : "unknown";
}

bool validate(const Request& request) {
  if (request.id > schema::kRequestId.max) return false;
  switch (request.kind) {
    case Request::Kind::kDetail: {
      const double north = request.north_max - request.north_min, east = request.east_max - request.east_min;
      const double level = std::log2(request.spacing);
      return fits(schema::kDetailCorner, request.north_min) &&
             fits(schema::kDetailCorner, request.east_min) && fits(schema::kDetailSide, north) &&
             fits(schema::kDetailSide, east) && schema::kDetailSpacing.valid(level) &&
             level == std::round(level) && fits(schema::kDetailError, request.max_error);
    }
    case Request::Kind::kRate:
      return fits(schema::kRequestRate, request.rate_bps);
    case Request::Kind::kPauseMap:
    case Request::Kind::kResumeMap:
    case Request::Kind::kSendStatus:
      return true;
  }
  return false;
}

bool validate(const UsblFixMessage& fix) {
  return schema::kFixLatitude.valid(fix.latitude) && schema::kFixLongitude.valid(fix.longitude) &&
         schema::kFixDepth.valid(fix.depth) && schema::kFixSigma.valid(fix.sigma);
}

DownlinkCounter downlinkCounterAt(std::int64_t utc_ns) {
  const std::int64_t since = utc_ns - schema::kTimeEpoch_s * kSecond_ns;
  const std::int64_t ticks = since / kTick_ns + (since % kTick_ns > 0 ? 1 : 0);
  return static_cast<DownlinkCounter>(
      std::clamp<std::int64_t>(ticks, 0, std::numeric_limits<DownlinkCounter>::max()));
}

std::int64_t downlinkTime(DownlinkCounter counter) {
  return schema::kTimeEpoch_s * kSecond_ns + static_cast<std::int64_t>(counter) * kTick_ns;
}

std::size_t encodeDownlink(const DownlinkContent& content, DownlinkCounter counter, bool is_signed,
                           std::span<std::uint8_t> out) {
  if (content.fix &&
      (!validate(*content.fix) || !schema::kFixAge.valid(secondsBefore(counter, content.fix->utc_ns))))
    return 0;
  if (content.request && !validate(*content.request)) return 0;
  BitWriter w(out);
  w.put(is_signed ? 1 : 0, 1);
  w.put(content.fix ? 1 : 0, 1);
  w.put(content.request ? 1 : 0, 1);
  const std::size_t acknowledgement_flag = w.bits();
  w.put(0, 1);
  w.put(counter, kCounterBits);
  if (content.fix) put(w, *content.fix, counter);
  if (content.request) put(w, *content.request);
  const bool acknowledges =
      content.acknowledgement && content.acknowledgement->valid && w.bitsLeft() >= kSequenceBits;
  if (!w.ok() || (!content.fix && !content.request && !acknowledges)) return 0;
  if (acknowledges) {
    out[acknowledgement_flag / kByteBits] |= 0x80U >> acknowledgement_flag % kByteBits;
    put(w, *content.acknowledgement);
  }
  return w.ok() ? w.bytes() : 0;
}

bool decodeDownlink(std::span<const std::uint8_t> bytes, DecodedDownlink& out) {
  DecodedDownlink decoded;
  BitReader r(bytes);
  decoded.is_signed = r.get(1) != 0;
  const bool has_fix = r.get(1) != 0, has_request = r.get(1) != 0, has_acknowledgement = r.get(1) != 0;
  decoded.counter = static_cast<DownlinkCounter>(r.get(kCounterBits));
  if (has_fix) decoded.content.fix = getFix(r, decoded.counter);
  if (has_request) decoded.content.request = getRequest(r);
  if (has_acknowledgement) decoded.content.acknowledgement = getAcknowledgement(r);
  if (!r.ok() || decoded.content.empty() || !r.finished()) return false;
  if (decoded.content.acknowledgement && !decoded.content.acknowledgement->valid) return false;
  if (decoded.content.fix && !validate(*decoded.content.fix)) return false;
  if (decoded.content.request && !validate(*decoded.content.request)) return false;
  out = decoded;
  return true;
}

}  // namespace fathom::telemetry
