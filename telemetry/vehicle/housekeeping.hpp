#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "telemetry/vehicle/block_queue.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::telemetry {

// The points of the dive's track, each with the last frame that carried it and whether the ship has it. Every
// track message carries the newest points; lost ones are sent again in spare time. Bounded: of more than
// kMost points the oldest are dropped. Only the constructor allocates.
class TrackLog {
 public:
  static constexpr std::size_t kMost = 4096;  // five hours at 5 s

  TrackLog() { points_.reserve(kMost); }

  // Adds a point later than the last; an earlier one (the clock was set back) starts a new track.
  void add(const TrackPoint& point);
  [[nodiscard]] bool empty() const { return points_.empty(); }
  [[nodiscard]] std::int64_t newestUtcNs() const { return points_.back().at.utc_ns; }

  // Writes a message of at most `most` points, the newest or those around the oldest lost one, to be sent
  // with frame `version`; 0: none.
  [[nodiscard]] std::size_t newest(std::size_t most, Version version, std::span<std::uint8_t> out);
  [[nodiscard]] std::size_t lost(std::size_t most, Version version, std::span<std::uint8_t> out);

  // The outcome of one frame; and of all earlier frames (see BlockQueue::settle).
  void word(Version version, bool arrived);
  void settle(const BlockQueue::Holds& holds, Version oldest);

  [[nodiscard]] std::size_t memoryBytes() const { return points_.capacity() * sizeof(Point); }

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t size = self.points_.size();
    archive(size);
    archive.require(size <= kMost, "more of a track than there is room for");
    if constexpr (Archive::kLoading) {
      if (!archive.ok()) return;
      self.points_.resize(size);
    }
    for (auto& p : self.points_) {
      archive.instants(p.at.utc_ns);
      archive(p.at.north, p.at.east, p.at.depth, p.last, p.confirmed, p.lost);
    }
  }

 private:
  struct Point {
    TrackPoint at;
    Version last = 0;  // frame; 0: none
    bool confirmed = false, lost = false;
  };
  std::size_t encode(std::size_t first, std::size_t count, Version version, std::span<std::uint8_t> out);

  std::vector<Point> points_;  // oldest first
};

struct HousekeepingConfig {
  double share = 0.05;  // of the rate; the periods stretch to keep it
  double status_period_s = 10;
  double mission_info_period_s = 120;
  double track_interval_s = 5;  // between points of the track
  int track_points = 24;        // a track message carries this many of the last points

  void validate() const;  // throws std::invalid_argument naming the value
};

// Schedules report, status, mission info and track. The report is sent at once when a request's outcome
// changes or a health flag is raised; report and mission info are repeated until they are acknowledged. When
// a frame has room for only a few track points, the status messages are the track.
class Housekeeping {
 public:
  Housekeeping(const HousekeepingConfig& config, int frame_bytes, double loss);
  // Computes the periods for a rate; none is shorter than `least_s`.
  void plan(double rate_bps, double least_s);

  void setStatus(const Status& status);
  // Sets the report, with the status's health. `loss`: share of frames that are lost now.
  void setReport(StateReport report, double loss);
  void setMissionInfo(const MissionInfo& info) { info_ = info; }
  void sendStatusNow() { status_timer_.next_ns = 0; }

  // Writes the payload of the message that is due, to be sent with frame `version`; 0: none.
  [[nodiscard]] std::size_t next(std::int64_t now_ns, Version version, std::span<std::uint8_t> out,
                                 MessageType& type);
  // The outcome of one frame; and of all earlier frames (see BlockQueue::settle).
  void word(Version version, bool arrived);
  void settle(const BlockQueue::Holds& holds, Version oldest);
  // Status while the link has nothing else to send, at the period as configured, not stretched; 0: none.
  [[nodiscard]] std::size_t spareStatus(std::int64_t now_ns, std::span<std::uint8_t> out);

  // Lost points of the track, for spare time; 0: none.
  [[nodiscard]] std::size_t spareTrack(Version version, std::span<std::uint8_t> out);

  [[nodiscard]] double stretch() const { return stretch_; }  // factor on the periods

  // In link_scheduler_state.cpp: all but mission info, bit by bit, into one that has planned for the same
  // rate.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  struct Timer {
    std::int64_t period_ns = 0;
    std::int64_t next_ns = 0;
    [[nodiscard]] bool due(std::int64_t now_ns) const { return now_ns >= next_ns; }
    void done(std::int64_t now_ns) { next_ns = now_ns + period_ns; }
  };

  HousekeepingConfig config_;
  std::size_t room_;  // payload of a frame [B]
  double loss_;
  int report_sendings_ = 1;         // in quick succession, so that one arrives
  std::int64_t report_gap_ns_ = 0;  // between them, longer than a short burst of loss
  std::optional<Status> status_;
  std::optional<MissionInfo> info_;
  TrackLog track_;
  std::size_t track_points_ = 0;  // of a message; 0: none are sent
  std::int64_t track_interval_ns_ = 0;
  [[nodiscard]] std::size_t status(std::int64_t now_ns, std::span<std::uint8_t> out);

  // A message that is repeated until the ship has acknowledged its present content.
  struct Kept {
    Version last = 0;        // the frame that carried its present content; 0: none
    bool confirmed = false;  // acknowledged by the ship
    int sendings = 0;
    // Notes a frame's outcome; false: the message is to be sent again.
    bool word(Version version, bool arrived);

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.last, self.confirmed, self.sendings);
    }
  };
  std::optional<StateReport> report_;
  std::uint16_t sent_health_ = 0;                    // in the last report or status that was sent
  Kept report_kept_{.confirmed = true}, info_kept_;  // a first report without news is not sent
  Timer status_timer_, info_timer_, track_timer_, report_timer_;
  double stretch_ = 1, least_s_ = 0;
};

// Number of sendings after which a message arrives with probability >= goal when each is lost with
// probability `loss`: the least n with 1 - loss^n >= goal.
[[nodiscard]] int repeatsForGoal(double loss, double goal);

}  // namespace fathom::telemetry
