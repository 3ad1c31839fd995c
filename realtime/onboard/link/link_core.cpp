#include "realtime/onboard/link/link_core.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace fathom::onboard {
namespace {

constexpr double kNanoseconds = 1e9;  // in a second
// A map that was built anew changes in many squares at once; offerTiles() is called many times a second.
constexpr int kOffersAtOnce = 16;

// Seen area of a tile: a node stands for the square around it; the last row and column belong to neighbours.
double seenArea(const HeightTile& tile) {
  double area = 0;
  for (int i = 0; i < HeightTile::kCells; ++i)
    for (int j = 0; j < HeightTile::kCells; ++j)
      area += static_cast<double>(std::min(tile.at(i, j).coverage, 1.0F));
  return area * tile.spacing() * tile.spacing();
}

}  // namespace

void LinkCoreConfig::validate() const {
  scheduler.validate();
  if (tile_level < 0 || tile_level > 12) throw std::invalid_argument("link tile level must be 0 to 12");
  if (!(settle_s >= 0 && settle_s <= 3600)) throw std::invalid_argument("settle time must be 0 to 3600 s");
  if (!(max_wait_s >= settle_s && max_wait_s <= 3600))
    throw std::invalid_argument("longest wait must be from the settle time to 3600 s");
  if (max_changed < 1) throw std::invalid_argument("at least one changed tile must be remembered");
}

LinkCore::LinkCore(const LinkCoreConfig& config)
    : config_((config.validate(), config)), scheduler_(config.scheduler) {}

void LinkCore::setStatus(telemetry::Status status) {
  status.map_area = area_total_;
  scheduler_.setStatus(status);
}

void LinkCore::noteMapped(const MapOutput& output, double root_size) {
  if (output.nodes_updated > 0)
    noteChanged(output.min_north_east, output.max_north_east, output.utc_ns, root_size);
}

void LinkCore::noteChanged(const Eigen::Vector2d& min_north_east, const Eigen::Vector2d& max_north_east,
                           std::int64_t utc_ns, double root_size) {
  const double size = root_size / std::exp2(config_.tile_level);
  const auto index = [&](double metres) { return static_cast<std::int32_t>(std::floor(metres / size)); };
  for (std::int32_t n = index(min_north_east.x()); n <= index(max_north_east.x()); ++n) {
    for (std::int32_t e = index(min_north_east.y()); e <= index(max_north_east.y()); ++e) {
      auto [it, added] = changed_.try_emplace({n, e}, Change{utc_ns, utc_ns});
      it->second.last_ns = utc_ns;
    }
  }
}

void LinkCore::offer(const fusion::QuadtreeMap& map, const Key& key) {
  HeightTile tile;
  if (!map.extract({key.north, key.east, static_cast<std::int16_t>(config_.tile_level)}, tile)) return;
  const double area = seenArea(tile);
  Offered& known = offered_[key];
  area_total_ += area - known.area;
  known.area = area;
  tile.revision = ++known.revision;
  scheduler_.offer(tile);
}

void LinkCore::offerTiles(const fusion::QuadtreeMap& map, std::int64_t now_ns, bool everything) {
  const auto seconds_since = [&](std::int64_t t) { return static_cast<double>(now_ns - t) / kNanoseconds; };
  int offered = 0;
  for (auto it = changed_.begin(); it != changed_.end();) {
    const bool due =
        everything || (offered < kOffersAtOnce && (seconds_since(it->second.last_ns) >= config_.settle_s ||
                                                   seconds_since(it->second.first_ns) >= config_.max_wait_s));
    offered += due ? 1 : 0;
    if (due) offer(map, it->first);
    it = due ? changed_.erase(it) : std::next(it);
  }
  while (changed_.size() > config_.max_changed) {
    const auto oldest = std::min_element(changed_.begin(), changed_.end(), [](const auto& a, const auto& b) {
      return a.second.first_ns < b.second.first_ns;
    });
    offer(map, oldest->first);
    changed_.erase(oldest);
  }
}

bool LinkCore::drained() const {
  return changed_.empty() && scheduler_.counters().tiles_waiting == 0;
}

}  // namespace fathom::onboard
