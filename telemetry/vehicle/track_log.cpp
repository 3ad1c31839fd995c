#include "telemetry/vehicle/track_log.hpp"

#include <algorithm>
#include <array>

namespace fathom::telemetry {

void TrackLog::add(const TrackPoint& point) {
  if (!points_.empty() && point.utc_ns < newestUtcNs()) points_.clear();
  if (points_.size() == kMost) points_.erase(points_.begin(), points_.begin() + kMost / 8);
  points_.push_back({point});
}

std::size_t TrackLog::encode(std::size_t first, std::size_t count, Version version,
                             std::span<std::uint8_t> out) {
  std::array<TrackPoint, kMaxTrackPoints> sent, decoded;
  count = std::min({count, kMaxTrackPoints, points_.size() - first});
  for (std::size_t k = 0; k < count; ++k) sent[k] = points_[first + k].at;
  const std::size_t size = encodeTrack(std::span(sent).first(count), out);
  if (size == 0) return 0;
  // The newest that fit.
  const std::size_t carried = decodeTrack(out.first(size), decoded);
  for (std::size_t k = count - carried; k < count; ++k) {
    points_[first + k].last = version;
    points_[first + k].lost = false;
  }
  return size;
}

std::size_t TrackLog::newest(std::size_t most, Version version, std::span<std::uint8_t> out) {
  if (points_.empty()) return 0;
  const std::size_t count = std::min(most, points_.size());
  return encode(points_.size() - count, count, version, out);
}

std::size_t TrackLog::lost(std::size_t most, Version version, std::span<std::uint8_t> out) {
  const auto first =
      std::find_if(points_.begin(), points_.end(), [](const Point& p) { return p.lost && !p.confirmed; });
  if (first == points_.end()) return 0;
  // As few as fit at any step width, so that the first of them is carried.
  constexpr unsigned kHeadBits = 100, kWidestStepBits = 10 + 3 * 22;
  const std::size_t fit =
      1 + (out.size() * 8 - std::min<std::size_t>(out.size() * 8, kHeadBits)) / kWidestStepBits;
  return encode(static_cast<std::size_t>(first - points_.begin()), std::min(most, fit), version, out);
}

void TrackLog::word(Version version, bool arrived) {
  for (Point& p : points_) {
    if (p.last != version) continue;
    p.confirmed = p.confirmed || arrived;
    p.lost = !p.confirmed;
  }
}

void TrackLog::settle(const BlockQueue::Holds& holds, Version oldest) {
  for (Point& p : points_) {
    // An unacknowledged point stays as it is while its frame may be acknowledged.
    if (p.last == 0 || (!p.confirmed && p.last >= oldest)) continue;
    p.confirmed = holds(p.last).value_or(p.confirmed);
    p.lost = !p.confirmed;
  }
}

}  // namespace fathom::telemetry
