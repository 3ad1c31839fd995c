#pragma once

#include <cstdint>
#include <span>

#include "telemetry/wire/field.hpp"

namespace fathom::telemetry {

struct TrackPoint {
  std::int64_t utc_ns = 0;
  double north = 0, east = 0, depth = 0;  // nav [m]
};

// The last points of the track, newest first in the payload: the newest in full, each older one as
// differences of the quantised values (so a point decodes to the same numbers from every message that carries
// it). One width serves all differences of a message. Each point travels in several messages, so that a lost
// frame leaves no gap.
inline constexpr std::size_t kMaxTrackPoints = 63;

// Encodes the newest of `points` (oldest first, times rising) that fit; returns the payload's size, 0 for
// none.
[[nodiscard]] std::size_t encodeTrack(std::span<const TrackPoint> points, std::span<std::uint8_t> out);
// Writes the points oldest first into `out` (room for kMaxTrackPoints) and returns how many; 0 if not valid.
[[nodiscard]] std::size_t decodeTrack(std::span<const std::uint8_t> payload, std::span<TrackPoint> out);

}  // namespace fathom::telemetry
