#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "realtime/kernel/state_archive_fwd.hpp"
#include "telemetry/vehicle/block_queue.hpp"
#include "telemetry/vehicle/track_log.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/mission_info.hpp"
#include "telemetry/wire/report.hpp"
#include "telemetry/wire/status.hpp"
#include "telemetry/wire/track.hpp"

namespace fathom::telemetry {

struct HousekeepingConfig {
  double share = 0.05;  // of the rate; the periods stretch to keep it
  double status_period_s = 10;
  double mission_info_period_s = 120;
  double track_interval_s = 5;  // between points of the track
  int track_points = 24;        // a track message carries this many of the last points

  void validate() const;  // throws std::invalid_argument naming the value
};

// Report, status, mission info and track, and when each is due. The report goes at once when something of it
// changes that the ship should know, and report and mission info again until there is word that the ship has
// them. Where a frame has room for no more than a few track points, status messages make the track alone.
class Housekeeping {
 public:
  Housekeeping(const HousekeepingConfig& config, int frame_bytes, double loss);
  // At another rate the periods are other ones; none is shorter than `least_s`.
  void plan(double rate_bps, double least_s);

  void setStatus(const Status& status);
  // The health of it is the status's. `loss`: share of frames that are lost now.
  void setReport(Report report, double loss);
  void setMissionInfo(const MissionInfo& info) { info_ = info; }
  void sendStatusNow() { status_timer_.next_ns = 0; }

  // The payload of the message that is due, 0 for none; it goes with frame `version`.
  [[nodiscard]] std::size_t next(std::int64_t now_ns, Version version, std::span<std::uint8_t> out,
                                 MessageType& type);
  // There is word of a frame; and what there is to say of all frames of the past (see BlockQueue::settle).
  void word(Version version, bool arrived);
  void settle(const BlockQueue::Holds& holds, Version oldest);
  // While the link has nothing else to send: the status at its own period, not the stretched one; 0 for none.
  [[nodiscard]] std::size_t spareStatus(std::int64_t now_ns, std::span<std::uint8_t> out);

  // While there is time: points of the track that were lost; 0 for none.
  [[nodiscard]] std::size_t spareTrack(Version version, std::span<std::uint8_t> out);

  [[nodiscard]] double stretch() const { return stretch_; }  // factor on the periods

  // In link_state.cpp: bit by bit, but for mission info; into one that has planned for the same rate.
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
  int report_sendings_ = 1;         // at once, so that one arrives
  std::int64_t report_gap_ns_ = 0;  // between them: a short burst does not take two
  std::optional<Status> status_;
  std::optional<MissionInfo> info_;
  TrackLog track_;
  std::size_t track_points_ = 0;  // of a message; 0: none are sent
  std::int64_t track_interval_ns_ = 0;
  [[nodiscard]] std::size_t status(std::int64_t now_ns, std::span<std::uint8_t> out);

  // A message that the ship should have as it is.
  struct Kept {
    Version last = 0;   // the frame that carried it as it is; 0: none
    bool told = false;  // there was word that the ship has it
    int sendings = 0;
    // False: it has to go again.
    bool word(Version version, bool arrived);

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.last, self.told, self.sendings);
    }
  };
  std::optional<Report> report_;
  std::uint16_t told_health_ = 0;               // in the last report or status that was sent
  Kept report_kept_{.told = true}, info_kept_;  // of a report without news there is nothing to tell
  Timer status_timer_, info_timer_, track_timer_, report_timer_;
  double stretch_ = 1, least_s_ = 0;
};

// How often a message must be sent so that it arrives with probability >= goal when each is lost with
// probability `loss`: the least n with 1 - loss^n >= goal.
[[nodiscard]] int repeatsForGoal(double loss, double goal);

}  // namespace fathom::telemetry
