#pragma once

#include <cstdint>
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
                        const std::optional<telemetry::DownlinkKey>& key = std::nullopt)
      : link_(identity, key) {}

  // Takes one frame as received at `utc_ns`; says what became of it.
  telemetry::DecodedFrame accept(std::span<const std::uint8_t> bytes, std::int64_t utc_ns);

  // Frames that were accepted before the next are lost from the ship's file; see LinkReceiver.
  void noteDamage() { link_.noteDamage(); }

  // Asks the vehicle for something at the ship's next turn; false: out of bounds, too much waits, or it is
  // not known yet which vehicle to ask.
  [[nodiscard]] bool ask(const telemetry::Request& request, std::int64_t utc_ns);
  // Tells the vehicle a position at the ship's next turn.
  [[nodiscard]] bool tellFix(const telemetry::UsblFixMessage& fix);
  // The downlink frame to send now, 0 when there is none; see ShipLink.
  // `kept`: whether all that was received is where a power cut leaves it.
  [[nodiscard]] std::size_t speak(std::int64_t utc_ns, std::span<std::uint8_t> out,
                                  const telemetry::ShipLink::Kept& kept = {});
  [[nodiscard]] const RequestLedger& requests() const { return requests_; }
  [[nodiscard]] const telemetry::ShipLink& link() const { return link_; }

  // Grows with everything that changes what is to be shown.
  [[nodiscard]] std::uint64_t version() const { return version_; }
  [[nodiscard]] const telemetry::LinkReceiver& receiver() const { return link_.receiver(); }
  [[nodiscard]] const std::optional<telemetry::Status>& status() const { return status_; }
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
  void confirm(std::optional<std::uint8_t> request_id);  // it need not be said again
  void addTrack(std::int64_t utc_ns, const TrackRecord& record);

  static constexpr std::int64_t kClocksAgree_ns = 60'000'000'000;  // no frame is under way for longer
  static constexpr std::size_t kMaxTrack = 100'000;                // 5 h at 5 Hz; beyond, the oldest go

  telemetry::ShipLink link_;
  RequestLedger requests_;
  telemetry::TileReassembler reassembler_;
  ReceivedMap map_;
  std::optional<telemetry::Status> status_;
  telemetry::Version status_version_ = 0, mission_version_ = 0;
  std::optional<telemetry::MissionInfo> mission_;
  Track track_;
  LinkHistory history_;
  std::optional<std::int64_t> last_accepted_utc_ns_, clocks_apart_ns_;
  std::uint64_t version_ = 0, track_version_ = 0;
};

}  // namespace fathom::monitor
