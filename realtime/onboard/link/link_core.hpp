#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/onboard/map/map_core.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"

namespace fathom::onboard {

// Fraction of the planned path that the vehicle has covered. A waypoint is passed when the vehicle comes
// within the acceptance radius, or is nearer to the leg after it than to the leg before; beyond it the
// projection on the current leg counts. Never decreases.
class MissionProgress {
 public:
  // `plan`: waypoints (north, east) [m] in order; with fewer than two there is no progress.
  explicit MissionProgress(std::vector<Eigen::Vector2d> plan, double acceptance_radius = 3.0);

  void update(const Eigen::Vector2d& north_east);
  // 0 to 1; std::nullopt without a plan.
  [[nodiscard]] std::optional<double> fraction() const;

  // For saved state (state_archive.hpp), bit by bit, into one with the same plan.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t leg = self.leg_;
    archive(leg, self.travelled_);
    archive.require(leg == 0 || leg + 1 < self.plan_.size(), "a leg that is not in the plan");
    if constexpr (Archive::kLoading)
      if (archive.ok()) self.leg_ = leg;
  }

 private:
  std::vector<Eigen::Vector2d> plan_;
  std::vector<double> length_before_;  // of the path before each waypoint [m]
  double acceptance_radius_;           // [m]
  std::size_t leg_ = 0;                // from waypoint leg_ to leg_ + 1
  double travelled_ = 0;               // [m]
};

struct LinkCoreConfig {
  telemetry::LinkSchedulerConfig scheduler;
  double root_size = 32;           // of the map's quadtree [m]
  int max_level = 5;               // of the map's quadtree: detail goes no further
  double look_s = 1.0;             // before a square in view is offered again [s]
  std::size_t max_changed = 1024;  // changed squares remembered; when full the oldest is offered at once
  int max_detail_squares = 64;     // of one request; further ones are left out and counted
  std::size_t max_detailed = 512;  // squares of all requests that are followed when the map changes there

  void validate() const;  // throws std::invalid_argument naming the value
  // Level of the quadtree whose tiles have nodes at this spacing; negative if there is none.
  [[nodiscard]] int levelOf(double spacing) const;
};

// Best-effort core without threads, files or clocks: hands the changes of the map, as tiles of the link's two
// levels, to the scheduler, which decides when a block is worth sending; offers again what was evicted from
// the scheduler's pool or was emptied; serves requests for detail; gives the frames to send.
class LinkCore {
 public:
  explicit LinkCore(const LinkCoreConfig& config);
  LinkCore(const LinkCore&) = delete;  // the scheduler calls it
  LinkCore& operator=(const LinkCore&) = delete;

  void setMissionInfo(const telemetry::MissionInfo& info) { scheduler_.setMissionInfo(info); }
  // The caller fills navigation and health; the map's area is LinkCore's own.
  void setStatus(telemetry::Status status);

  // Notes the squares that a mapped pair touched.
  void noteMapped(const MapOutput& output);
  // Notes the squares of a part of the map that changed [m in nav].
  void noteChanged(const Eigen::Vector2d& min_north_east, const Eigen::Vector2d& max_north_east);
  // Offers changed squares (with `everything`, also those offered just now) and requested detail to the
  // scheduler.
  void offerTiles(const fusion::QuadtreeMap& map, std::int64_t now_ns, bool everything = false);

  // Messages of the ship; see LinkScheduler. `on_sent` is called for every square at the usual spacing that
  // the ship now holds whole.
  void acknowledge(const telemetry::Acknowledgement& a, std::int64_t now_ns,
                   const std::function<void(const fusion::TileKey&)>& on_sent = {});
  void request(const telemetry::Request& r, std::int64_t now_ns, telemetry::DownlinkCounter counter) {
    scheduler_.request(r, now_ns, counter);
  }
  void noteReceived(std::int64_t now_ns) { scheduler_.received(now_ns); }
  [[nodiscard]] std::optional<telemetry::Version> sentLately(const telemetry::Acknowledgement& a,
                                                             std::int64_t now_ns, double within_s) const {
    return scheduler_.sentLately(a, now_ns, within_s);
  }

  // See LinkScheduler: after load() and the log's tail, before the first frame.
  void noteRestart() { scheduler_.noteRestart(); }
  void noteSent(telemetry::Version next, std::int64_t now_ns) { scheduler_.noteSent(next, now_ns); }

  // The next frame for the modem, or 0: see LinkScheduler::nextFrame.
  [[nodiscard]] std::size_t nextFrame(std::int64_t now_ns, std::span<std::uint8_t> out) {
    return scheduler_.nextFrame(now_ns, out);
  }

  [[nodiscard]] telemetry::LinkScheduler::Counters counters() const { return scheduler_.counters(); }
  [[nodiscard]] bool drained() const;                              // nothing of the map waits to be sent
  [[nodiscard]] double mappedArea() const { return area_total_; }  // of the tiles offered so far [m2]
  [[nodiscard]] std::uint64_t detailLeftOut() const { return detail_left_out_; }  // squares
  [[nodiscard]] std::size_t memoryBytes() const { return scheduler_.memoryBytes(); }

  // Into one of the same configuration, which then gives the same frames bit by bit. Mission info is not part
  // of the state. A core is unusable after its load() failed.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  struct Key {
    std::int32_t north = 0, east = 0;

    auto operator<=>(const Key&) const = default;
  };

  // The squares of one level of the quadtree.
  struct Level {
    struct Square {
      std::int64_t looked_ns = 0;  // offered last
      double area = 0;             // seen then [m2]

      static void exchange(auto& archive, auto& self) {
        archive.instants(self.looked_ns);
        archive(self.area);
      }
    };
    int level = 0;
    double look_s = 0;  // between two looks at a square
    std::set<Key> changed;
    std::map<Key, Square> known;
    std::vector<Key> again;  // evicted from the link's pool with unsent content
    std::vector<Key> spare;  // evicted there with all content sent

    static void exchange(auto& archive, auto& self) {
      archive(self.changed, self.known, self.again, self.spare);
    }
  };
  // A square of requested detail that the ship was given.
  struct Detailed {
    std::int32_t level = 0;
    Key key;
    double max_error = 0;  // [m]
    bool changed = false;  // since it was offered
    std::int64_t looked_ns = 0;

    static void exchange(auto& archive, auto& self) {
      archive(self.level, self.key, self.max_error, self.changed);
      archive.instants(self.looked_ns);
    }
  };
  [[nodiscard]] HeightTile nothingAt(int level, const Key& key) const;
  void follow(int level, const Key& key, double max_error, std::int64_t now_ns);
  void offerDetailed(const fusion::QuadtreeMap& map, std::int64_t now_ns);
  void offer(Level& level, const fusion::QuadtreeMap& map, const Key& key, std::int64_t now_ns);
  void offerChanged(Level& level, const fusion::QuadtreeMap& map, std::int64_t now_ns, bool everything);
  void offerAgain(const fusion::QuadtreeMap& map, std::int64_t now_ns);
  void noteEvicted(const telemetry::BlockQueue::Whole& square, bool spare);
  void serveDetail(const fusion::QuadtreeMap& map, std::int64_t now_ns);
  [[nodiscard]] std::int32_t indexOf(double metres, int level) const;

  LinkCoreConfig config_;
  telemetry::LinkScheduler scheduler_;
  Level fine_, coarse_;
  std::vector<Detailed> detailed_;  // the latest last
  double area_total_ = 0;
  int detail_squares_ = 0;  // served of the oldest request
  std::uint64_t detail_left_out_ = 0;
};

}  // namespace fathom::onboard
