#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>

#include "telemetry/monitor/map/received_map.hpp"
#include "telemetry/monitor/model/coverage.hpp"
#include "telemetry/monitor/model/link_history.hpp"
#include "telemetry/monitor/model/request_ledger.hpp"
#include "telemetry/ship/ship_link.hpp"
#include "telemetry/tiles/tile_fragments.hpp"
#include "telemetry/wire/mission_info.hpp"
#include "telemetry/wire/status.hpp"
#include "telemetry/wire/track.hpp"

namespace fathom::monitor {

// What the ship knows of a dive: status, track and map, from frames in any state. Sans-I/O; bounded whatever
// arrives. Only whole frames of one vehicle and dive enter, each once.
class MonitorModel {
 public:
  // `key`: signs what is said to the vehicle.
  explicit MonitorModel(std::optional<telemetry::LinkIdentity> identity = std::nullopt,
                        const std::optional<telemetry::LinkKey>& key = std::nullopt)
      : link_(identity, key) {}

  // Takes one modem frame as received at `utc_ns`: `each` is called with every link frame in it and what
  // became of that. True: one was accepted.
  using Each = std::function<void(const telemetry::DecodedFrame&, std::span<const std::uint8_t>)>;
  bool hear(std::span<const std::uint8_t> modem_frame, std::int64_t utc_ns, const Each& each = {});
  // Takes one link frame as received at `utc_ns`; says what became of it.
  telemetry::DecodedFrame accept(std::span<const std::uint8_t> bytes, std::int64_t utc_ns);

  // Frames that were accepted before the next are lost from the ship's file; see LinkReceiver.
  void noteDamage() { link_.noteDamage(); }

  // Asks the vehicle for something at the ship's next turn; false: out of bounds, too much waits, or it is
  // not known yet which vehicle to ask.
  [[nodiscard]] bool ask(const telemetry::Request& request, std::int64_t utc_ns);
  // Tells the vehicle a position at the ship's next turn.
  [[nodiscard]] bool tellFix(const telemetry::UsblFixMessage& fix);
  // The modem frame to send now, 0 when there is none; see ShipLink.
  // `kept`: whether all that was received is where a power cut leaves it.
  [[nodiscard]] std::size_t speak(std::int64_t utc_ns, std::span<std::uint8_t> out,
                                  const telemetry::ShipLink::Kept& kept = {});
  [[nodiscard]] const RequestLedger& requests() const { return requests_; }
  [[nodiscard]] const telemetry::ShipLink& link() const { return link_; }

  // Grows with everything that changes what is to be shown.
  [[nodiscard]] std::uint64_t version() const { return version_; }
  [[nodiscard]] const telemetry::LinkReceiver& receiver() const { return link_.receiver(); }
  [[nodiscard]] const std::optional<telemetry::Status>& status() const { return status_; }
  // The newest report; its health is older or newer than the status's, see health().
  [[nodiscard]] const std::optional<telemetry::Report>& report() const { return report_; }
  // The newest word on health, of status or report (HealthFlag).
  [[nodiscard]] std::uint16_t health() const;
  [[nodiscard]] const std::optional<telemetry::MissionInfo>& mission() const { return mission_; }
  // The ship's time less the vehicle's, when the newest status came [ns]; what it was under way is in it.
  [[nodiscard]] std::optional<std::int64_t> clocksApart() const { return clocks_apart_ns_; }
  [[nodiscard]] bool schemaDiffers() const;  // the sender's fields are not ours
  [[nodiscard]] const ReceivedMap& map() const { return map_; }
  [[nodiscard]] const telemetry::TileReassembler& reassembler() const { return reassembler_; }
  // Track points by time, status positions included.
  [[nodiscard]] const Track& track() const { return track_; }
  [[nodiscard]] std::uint64_t trackVersion() const { return track_version_; }
  [[nodiscard]] const LinkHistory& history() const { return history_; }
  // Accepted frames by message type.
  [[nodiscard]] std::uint64_t accepted(telemetry::MessageType type) const;
  [[nodiscard]] std::optional<std::int64_t> lastAcceptedUtcNs() const { return last_accepted_utc_ns_; }

 private:
  // The ship speaks in the vehicle's time, where its own clock is off, or the vehicle's: what is said is then
  // as fresh to the vehicle as it is.
  [[nodiscard]] std::int64_t vehicleTime(std::int64_t utc_ns) const;
  [[nodiscard]] bool take(const telemetry::LinkReceiver::Message& message, std::int64_t utc_ns);
  // What was received of a dive before this one, or before the vehicle began anew, goes.
  void followBeginning();
  void addTrack(std::int64_t utc_ns, const TrackRecord& record);
  // Whether a status can be of now: its time is within a day of the ship's, or as far from it as that of the
  // one before. So a false one, or one damaged unseen, is not shown, and a clock that is years off costs one
  // status.
  [[nodiscard]] bool isOfNow(const telemetry::Status& status, std::int64_t utc_ns);
  // Whether a point of the track can be of the dive whose status is known.
  [[nodiscard]] bool isOfDive(std::int64_t point_utc_ns) const;

  static constexpr std::int64_t kClocksAgree_ns = 60'000'000'000;  // no frame is under way for longer
  static constexpr std::int64_t kOfNow_ns = 86'400'000'000'000;    // far more than any frame is late
  static constexpr std::int64_t kAsBefore_ns = 600'000'000'000;    // frames may be minutes late
  static constexpr std::int64_t kLongestDive_ns = 2 * kOfNow_ns;
  static constexpr std::size_t kMaxTrack = 100'000;  // 5 h at 5 Hz; beyond, the oldest go

  telemetry::ShipLink link_;
  RequestLedger requests_;
  telemetry::TileReassembler reassembler_;
  ReceivedMap map_;
  std::optional<telemetry::Status> status_;
  std::optional<telemetry::Report> report_;
  telemetry::Version began_ = 0, status_version_ = 0, report_version_ = 0, mission_version_ = 0;
  std::optional<telemetry::MissionInfo> mission_;
  Track track_;
  LinkHistory history_;
  std::optional<std::int64_t> last_accepted_utc_ns_, clocks_apart_ns_;
  std::optional<std::int64_t> last_apart_ns_;  // of the last status, shown or not
  std::uint64_t version_ = 0, track_version_ = 0;
};

}  // namespace fathom::monitor
