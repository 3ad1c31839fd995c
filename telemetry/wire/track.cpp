#include "telemetry/wire/track.hpp"

#include <algorithm>
#include <array>

#include "telemetry/wire/status.hpp"

namespace fathom::telemetry {
namespace {

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

}  // namespace

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

}  // namespace fathom::telemetry
