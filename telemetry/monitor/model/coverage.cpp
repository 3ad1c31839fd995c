#include "telemetry/monitor/model/coverage.hpp"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <numbers>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"

namespace fathom::monitor {
namespace {

constexpr int kSquares = static_cast<int>(kChunkSize_m);  // along a chunk

// One-metre squares by chunk.
class SquareMap {
 public:
  void set(std::int32_t north, std::int32_t east) { at(north, east) = true; }
  [[nodiscard]] bool test(std::int32_t north, std::int32_t east) const {
    const auto found = chunks_.find({north >> 4, east >> 4});
    return found != chunks_.end() && found->second.test(slot(north, east));
  }
  [[nodiscard]] double count() const {
    std::size_t sum = 0;
    for (const auto& [key, squares] : chunks_) sum += squares.count();
    return static_cast<double>(sum);
  }

 private:
  static std::size_t slot(std::int32_t north, std::int32_t east) {
    return static_cast<std::size_t>((north & 15) << 4 | (east & 15));
  }
  std::bitset<kSquares * kSquares>::reference at(std::int32_t north, std::int32_t east) {
    return chunks_[{north >> 4, east >> 4}][slot(north, east)];
  }
  std::map<ChunkKey, std::bitset<kSquares * kSquares>> chunks_;
};

void markReceived(const telemetry::MapBlock& block, SquareMap& squares) {
  const double spacing = telemetry::spacingOf(block.key.spacing), half = spacing / 2;
  for (int n = 0; n < telemetry::MapBlock::kNodes; ++n) {
    if (!block.isSeen(n)) continue;
    const int row = n / 4, column = n % 4;
    const double north = (4 * block.key.north + row) * spacing,
                 east = (4 * block.key.east + column) * spacing;
    // A node covers its cell; a fine one the square that holds it.
    const double reach = spacing > 1 ? half : 0;
    for (auto i = static_cast<std::int32_t>(std::floor(north - reach)); i <= north + reach; ++i)
      for (auto j = static_cast<std::int32_t>(std::floor(east - reach)); j <= east + reach; ++j)
        squares.set(i, j);
  }
}

}  // namespace

Coverage coverageOf(const Track& track, const BlockStore& store, std::int64_t now_utc_ns) {
  Coverage coverage;
  SquareMap received;
  constexpr auto kRecent_ns = static_cast<std::int64_t>(kRecent_s * 1e9);
  const std::int64_t recent = now_utc_ns - kRecent_ns;
  for (const auto& [key, chunk] : store.chunks()) {
    for (const auto& level : chunk->levels) {
      for (const auto& [slot, stored] : level) {
        markReceived(stored.block, received);
        if (stored.changed_utc_ns > recent && stored.changed_utc_ns != 0) {
          const double spacing = telemetry::spacingOf(stored.block.key.spacing);
          coverage.changed_area += std::bitset<16>(stored.block.seen).count() * spacing * spacing;
          coverage.changes_until_utc_ns =
              std::min(coverage.changes_until_utc_ns, stored.changed_utc_ns + kRecent_ns);
        }
      }
    }
  }
  coverage.received_area = received.count();

  SquareMap listed;
  const double share = std::tan(degreesToRadians(kViewAngle_deg / 2));
  const auto look = [&](double north, double east, double depth, double altitude) {
    // At least half a square's diagonal, so that the band of a low vehicle has no gaps.
    const double half = std::max(altitude * share, std::numbers::sqrt2 / 2);
    for (auto i = static_cast<std::int32_t>(std::floor(north - half)); i < north + half; ++i) {
      for (auto j = static_cast<std::int32_t>(std::floor(east - half)); j < east + half; ++j) {
        if (hypotenuse(i + 0.5 - north, j + 0.5 - east) > half || received.test(i, j) || listed.test(i, j))
          continue;
        listed.set(i, j);
        coverage.pending.push_back({i, j, static_cast<float>(depth + altitude)});
      }
    }
  };
  double altitude = kDefaultAltitude_m;
  for (auto at = track.begin(); at != track.end(); ++at) {
    const TrackRecord& here = at->second;
    if (std::isfinite(here.altitude)) altitude = here.altitude;
    if (altitude > kMaxAltitude_m) continue;
    const auto next = std::next(at);
    int steps = 1;
    if (next != track.end() && static_cast<double>(next->first - at->first) < kMaxGap_s * 1e9)
      steps =
          std::max(1, static_cast<int>(std::ceil(
                          hypotenuse(next->second.north - here.north, next->second.east - here.east) / 0.5)));
    constexpr int kMostSteps = 400;  // a jump further than any vehicle moves in the gap is no track
    if (steps > kMostSteps) steps = 1;
    for (int k = 0; k < steps; ++k) {
      const double f = static_cast<double>(k) / steps;
      const TrackRecord& to = steps > 1 ? next->second : here;
      look(here.north + f * (to.north - here.north), here.east + f * (to.east - here.east),
           here.depth + f * (to.depth - here.depth), altitude);
    }
  }
  std::sort(coverage.pending.begin(), coverage.pending.end(),
            [](const PendingSquare& a, const PendingSquare& b) {
              return std::pair(a.north, a.east) < std::pair(b.north, b.east);
            });
  return coverage;
}

}  // namespace fathom::monitor
