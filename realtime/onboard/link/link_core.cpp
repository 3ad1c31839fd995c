#include "realtime/onboard/link/link_core.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/units.hpp"

namespace fathom::onboard {
namespace {

// Nearest point of the segment a-b, as a fraction of its length.
double project(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
  const double length2 = (b - a).squaredNorm();
  return length2 > 0 ? std::clamp((p - a).dot(b - a) / length2, 0.0, 1.0) : 1.0;
}

double distanceTo(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
  return (a + project(a, b, p) * (b - a) - p).norm();
}

// A rebuilt map changes in many squares at once; offerTiles() is called many times a second.
constexpr int kOffersAtOnce = 16;
constexpr double kCoarseLooks = 4;  // at a coarse square before it may be wanted

// Seen area of a tile: a node stands for the square around it; the last row and column belong to neighbours.
double seenArea(const HeightTile& tile) {
  double area = 0;
  for (int i = 0; i < HeightTile::kCells; ++i)
    for (int j = 0; j < HeightTile::kCells; ++j)
      area += static_cast<double>(std::min(tile.at(i, j).coverage, 1.0F));
  return area * tile.spacing() * tile.spacing();
}

}  // namespace

MissionProgress::MissionProgress(std::vector<Eigen::Vector2d> plan, double acceptance_radius)
    : plan_(std::move(plan)), acceptance_radius_(acceptance_radius) {
  double length = 0;
  for (std::size_t i = 0; i < plan_.size(); ++i) {
    if (i > 0) length += (plan_[i] - plan_[i - 1]).norm();
    length_before_.push_back(length);
  }
}

void MissionProgress::update(const Eigen::Vector2d& north_east) {
  if (plan_.size() < 2) return;
  while (leg_ + 2 < plan_.size()) {
    const bool reached = (north_east - plan_[leg_ + 1]).norm() < acceptance_radius_;
    const bool on_next = distanceTo(plan_[leg_ + 1], plan_[leg_ + 2], north_east) <
                         std::min(acceptance_radius_, distanceTo(plan_[leg_], plan_[leg_ + 1], north_east));
    if (!reached && !on_next) break;
    ++leg_;
  }
  const double s = project(plan_[leg_], plan_[leg_ + 1], north_east);
  travelled_ =
      std::max(travelled_, length_before_[leg_] + s * (length_before_[leg_ + 1] - length_before_[leg_]));
}

std::optional<double> MissionProgress::fraction() const {
  if (plan_.size() < 2 || length_before_.back() <= 0) return std::nullopt;
  return travelled_ / length_before_.back();
}

int LinkCoreConfig::levelOf(double spacing) const {
  const double level = std::log2(root_size / (spacing * HeightTile::kCells));
  return level >= 0 && level <= 20 && level == std::round(level) ? static_cast<int>(level) : -1;
}

void LinkCoreConfig::validate() const {
  scheduler.validate();
  const int level = levelOf(scheduler.blocks.spacing);
  if (level < 0 || level > max_level)
    throw std::invalid_argument("spacing_m is not the map's root size / 16 over a power of two, or too fine");
  if (levelOf(scheduler.blocks.coarse_spacing) < 0)
    throw std::invalid_argument("coarse_spacing_m is not the map's root size / 16 over a power of two");
  if (!(look_s >= 0 && look_s <= 3600)) throw std::invalid_argument("look time must be 0 to 3600 s");
  if (max_changed < 1) throw std::invalid_argument("at least one changed square must be remembered");
  if (max_detailed < 1) throw std::invalid_argument("a square of detail must be followed at least");
  if (max_detail_squares < 1) throw std::invalid_argument("a request must be served with a square at least");
}

LinkCore::LinkCore(const LinkCoreConfig& config)
    : config_((config.validate(), config)), scheduler_(config.scheduler) {
  fine_.level = config.levelOf(config.scheduler.blocks.spacing);
  fine_.look_s = config.look_s;
  coarse_.level = config.levelOf(config.scheduler.blocks.coarse_spacing);
  scheduler_.onEvicted(
      [this](const telemetry::BlockQueue::Whole& square, bool spare) { noteEvicted(square, spare); });
  coarse_.look_s = std::max(config.look_s, config.scheduler.blocks.coarse_after_s / kCoarseLooks);
}

std::int32_t LinkCore::indexOf(double metres, int level) const {
  return static_cast<std::int32_t>(std::floor(metres * std::exp2(level) / config_.root_size));
}

void LinkCore::acknowledge(const telemetry::Acknowledgement& a, std::int64_t now_ns,
                           const std::function<void(const fusion::TileKey&)>& on_sent) {
  const auto spacing = telemetry::spacingCode(config_.scheduler.blocks.spacing);
  scheduler_.acknowledge(a, now_ns, [&](const telemetry::BlockQueue::Whole& square) {
    if (on_sent && square.spacing == spacing)
      on_sent({square.north, square.east, static_cast<std::int16_t>(fine_.level)});
  });
}

void LinkCore::setStatus(telemetry::Status status) {
  status.map_area = area_total_;
  scheduler_.setStatus(status);
}

void LinkCore::noteMapped(const MapOutput& output) {
  if (output.nodes_updated > 0) noteChanged(output.min_north_east, output.max_north_east);
}

void LinkCore::noteChanged(const Eigen::Vector2d& min_north_east, const Eigen::Vector2d& max_north_east) {
  for (Level* level : {&fine_, &coarse_}) {
    if (level == &coarse_ && coarse_.level == fine_.level) continue;
    const auto index = [&](double metres) { return indexOf(metres, level->level); };
    for (std::int32_t n = index(min_north_east.x()); n <= index(max_north_east.x()); ++n)
      for (std::int32_t e = index(min_north_east.y()); e <= index(max_north_east.y()); ++e)
        level->changed.insert({n, e});
  }
  for (Detailed& d : detailed_) {
    const auto within = [&](std::int32_t at, double least, double most) {
      return at >= indexOf(least, d.level) && at <= indexOf(most, d.level);
    };
    d.changed = d.changed || (within(d.key.north, min_north_east.x(), max_north_east.x()) &&
                              within(d.key.east, min_north_east.y(), max_north_east.y()));
  }
}

HeightTile LinkCore::nothingAt(int level, const Key& key) const {
  HeightTile tile;
  tile.north_index = key.north;
  tile.east_index = key.east;
  tile.level = level;
  tile.size = config_.root_size / std::exp2(level);
  return tile;
}

void LinkCore::offer(Level& level, const fusion::QuadtreeMap& map, const Key& key, std::int64_t now_ns) {
  HeightTile tile;
  const fusion::TileKey place{key.north, key.east, static_cast<std::int16_t>(level.level)};
  if (!map.extract(place, tile)) {
    // The map has left this place: so must what was sent of it.
    if (!level.known.contains(key)) return;
    tile = nothingAt(level.level, key);
  }
  Level::Square& square = level.known[key];
  square.looked_ns = now_ns;
  if (&level == &fine_) {
    const double area = seenArea(tile);
    area_total_ += area - square.area;
    square.area = area;
  }
  scheduler_.offer(tile, now_ns);
}

void LinkCore::offerChanged(Level& level, const fusion::QuadtreeMap& map, std::int64_t now_ns,
                            bool everything) {
  int offered = 0;
  for (auto it = level.changed.begin(); it != level.changed.end();) {
    const auto known = level.known.find(*it);
    const bool due =
        everything || known == level.known.end() ||
        static_cast<double>(now_ns - known->second.looked_ns) >= level.look_s * kNanosecondsPerSecond ||
        level.changed.size() > config_.max_changed;
    if (!due || (!everything && offered == kOffersAtOnce)) {
      ++it;
      continue;
    }
    ++offered;
    offer(level, map, *it, now_ns);
    it = level.changed.erase(it);
  }
}

void LinkCore::offerTiles(const fusion::QuadtreeMap& map, std::int64_t now_ns, bool everything) {
  offerChanged(fine_, map, now_ns, everything);
  offerChanged(coarse_, map, now_ns, everything);
  offerAgain(map, now_ns);
  offerDetailed(map, now_ns);
  serveDetail(map, now_ns);
}

void LinkCore::offerAgain(const fusion::QuadtreeMap& map, std::int64_t now_ns) {
  for (Level* level : {&fine_, &coarse_}) {
    const auto next = [&](std::vector<Key>& keys) {
      const Key key = keys.front();
      keys.erase(keys.begin());
      offer(*level, map, key, now_ns);
    };
    for (int k = 0; k < kOffersAtOnce && !level->again.empty() && scheduler_.hasRoom(); ++k)
      next(level->again);
    for (int k = 0; k < kOffersAtOnce && level->again.empty() && !level->spare.empty() && scheduler_.spare();
         ++k)
      next(level->spare);
  }
}

void LinkCore::noteEvicted(const telemetry::BlockQueue::Whole& square, bool spare) {
  for (Level* level : {&fine_, &coarse_}) {
    const double spacing = config_.root_size / (std::exp2(level->level) * HeightTile::kCells);
    if (telemetry::spacingCode(spacing) != square.spacing) continue;
    std::vector<Key>& keys = spare ? level->spare : level->again;
    const Key key{square.north, square.east};
    if (std::find(keys.begin(), keys.end(), key) == keys.end()) keys.push_back(key);
    return;
  }
  for (Detailed& d : detailed_) {
    const double spacing = config_.root_size / (std::exp2(d.level) * HeightTile::kCells);
    if (telemetry::spacingCode(spacing) == square.spacing && d.key == Key{square.north, square.east})
      d.changed = true;
  }
}

// The map continues to change where the ship received detail: its copy must follow.
void LinkCore::offerDetailed(const fusion::QuadtreeMap& map, std::int64_t now_ns) {
  int offered = 0;
  for (Detailed& d : detailed_) {
    if (!d.changed || offered == kOffersAtOnce || !scheduler_.hasRoom() ||
        static_cast<double>(now_ns - d.looked_ns) < config_.look_s * kNanosecondsPerSecond)
      continue;
    HeightTile tile;
    const fusion::TileKey place{d.key.north, d.key.east, static_cast<std::int16_t>(d.level)};
    scheduler_.offer(map.extract(place, tile) ? tile : nothingAt(d.level, d.key), now_ns, d.max_error);
    d.changed = false;
    d.looked_ns = now_ns;
    ++offered;
  }
}

void LinkCore::follow(int level, const Key& key, double max_error, std::int64_t now_ns) {
  if (level == fine_.level || level == coarse_.level) return;  // followed anyway
  const auto same = [&](const Detailed& d) { return d.level == level && d.key == key; };
  if (const auto known = std::find_if(detailed_.begin(), detailed_.end(), same); known != detailed_.end()) {
    known->max_error = std::min(known->max_error, max_error);
    return;
  }
  if (detailed_.size() == config_.max_detailed) detailed_.erase(detailed_.begin());
  detailed_.push_back({level, key, max_error, false, now_ns});
}

void LinkCore::serveDetail(const fusion::QuadtreeMap& map, std::int64_t now_ns) {
  const telemetry::LinkScheduler::Detail* detail = scheduler_.detail();
  if (detail == nullptr) return;
  const int level = std::clamp(config_.levelOf(detail->spacing), 0, config_.max_level);
  const std::int32_t n0 = indexOf(detail->north_min, level), n1 = indexOf(detail->north_max, level);
  const std::int32_t e0 = indexOf(detail->east_min, level), e1 = indexOf(detail->east_max, level);
  const std::int64_t columns = e1 - e0 + 1, all = (n1 - n0 + 1) * columns;
  const auto served = static_cast<int>(std::min<std::int64_t>(all, config_.max_detail_squares));
  for (int k = 0; k < kOffersAtOnce && detail_squares_ < served; ++k) {
    HeightTile tile;
    const fusion::TileKey key{static_cast<std::int32_t>(n0 + detail_squares_ / columns),
                              static_cast<std::int32_t>(e0 + detail_squares_ % columns),
                              static_cast<std::int16_t>(level)};
    if (map.extract(key, tile)) {
      scheduler_.offer(tile, now_ns, detail->max_error);
      follow(level, {key.north_index, key.east_index}, detail->max_error, now_ns);
    }
    ++detail_squares_;
  }
  if (detail_squares_ < served) return;
  detail_left_out_ += static_cast<std::uint64_t>(all - served);
  detail_squares_ = 0;
  scheduler_.detailServed();
}

bool LinkCore::drained() const {
  const auto idle = [](const Level& level) { return level.changed.empty() && level.again.empty(); };
  const bool followed =
      std::none_of(detailed_.begin(), detailed_.end(), [](const Detailed& d) { return d.changed; });
  return followed && idle(fine_) && idle(coarse_) && scheduler_.drained();
}

namespace {

constexpr std::uint32_t kTag = rt::stateTag("LNKC"), kVersion = 3;

}  // namespace

template <typename Archive, typename Self>
void LinkCore::exchange(Archive& archive, Self& self) {
  archive(self.fine_, self.coarse_, self.detailed_, self.area_total_, self.detail_squares_,
          self.detail_left_out_);
  archive.require(self.detailed_.size() <= self.config_.max_detailed, "more detail than is followed");
  archive.require(self.detail_squares_ >= 0, "fewer squares served than none");
}

void LinkCore::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
  writer(scheduler_);
}

bool LinkCore::load(rt::StateReader& reader) {
  return reader.section(kTag, kVersion, [&] { exchange(reader, *this); }) && reader(scheduler_);
}

}  // namespace fathom::onboard
