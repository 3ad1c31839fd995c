#pragma once

#include <cstdint>
#include <map>
#include <span>

#include "realtime/onboard/map/map_core.hpp"
#include "telemetry/link_scheduler.hpp"

namespace fathom::onboard {

struct LinkCoreConfig {
  telemetry::LinkSchedulerConfig scheduler;
  int tile_level = 3;              // of the quadtree: the squares that are sent
  double settle_s = 4.0;           // a tile is offered when the vehicle has not touched it for so long [s]
  double max_wait_s = 30.0;        // or when its first unsent change is so old [s]
  std::size_t max_changed = 1024;  // changed tiles remembered; when full the oldest is offered at once

  void validate() const;  // throws std::invalid_argument naming the value
};

// Best-effort core without threads, files or clocks: turns what the map gains into tiles of one level, hands
// them to the link scheduler when the vehicle has left them, and gives the frames to send.
class LinkCore {
 public:
  explicit LinkCore(const LinkCoreConfig& config);

  void setMissionInfo(const telemetry::MissionInfo& info) { scheduler_.setMissionInfo(info); }
  // The caller fills navigation and health; map tiles and area are LinkCore's own.
  void setStatus(telemetry::Status status);

  // Notes the squares that a mapped pair touched.
  void noteMapped(const MapOutput& output, double root_size);
  // Notes the squares of a part of the map that changed [m in nav].
  void noteChanged(const Eigen::Vector2d& min_north_east, const Eigen::Vector2d& max_north_east,
                   std::int64_t utc_ns, double root_size);
  // Offers what has settled by `now_ns` (with `everything`: all that changed) to the scheduler.
  void offerTiles(const fusion::QuadtreeMap& map, std::int64_t now_ns, bool everything = false);

  // The next frame for the modem, or 0: see LinkScheduler::nextFrame.
  [[nodiscard]] std::size_t nextFrame(std::int64_t now_ns, std::span<std::uint8_t> out) {
    return scheduler_.nextFrame(now_ns, out);
  }

  [[nodiscard]] telemetry::LinkScheduler::Counters counters() const { return scheduler_.counters(); }
  [[nodiscard]] bool drained() const;  // every tile offered has been sent often enough
  [[nodiscard]] double mappedArea() const { return area_total_; }  // of the tiles offered so far [m2]
  [[nodiscard]] std::size_t memoryBytes() const { return scheduler_.memoryBytes(); }

 private:
  struct Key {
    std::int32_t north = 0, east = 0;
    auto operator<=>(const Key&) const = default;
  };
  struct Change {
    std::int64_t first_ns = 0, last_ns = 0;
  };

  void offer(const fusion::QuadtreeMap& map, const Key& key);

  LinkCoreConfig config_;
  telemetry::LinkScheduler scheduler_;
  std::map<Key, Change> changed_;
  struct Offered {
    double area = 0;             // seen [m2]
    std::uint32_t revision = 0;  // of this tile alone: frames carry its low bits only, so it must not leap
  };
  std::map<Key, Offered> offered_;
  double area_total_ = 0;
};

}  // namespace fathom::onboard
