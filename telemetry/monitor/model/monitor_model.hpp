#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>

#include "telemetry/monitor/map/received_map.hpp"
#include "telemetry/monitor/model/coverage.hpp"
#include "telemetry/monitor/model/link_history.hpp"
#include "telemetry/ship/ship_link.hpp"
#include "telemetry/tiles/tile_codec.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::monitor {

// The ship's model of a dive: status, track and map, from any bytes received. Sans-I/O; bounded for any
// input. Admits only whole frames of one vehicle and dive, each once.
class MonitorModel {
 public:
  // `key`: verifies the vehicle's frames and signs those to it.
  explicit MonitorModel(std::optional<telemetry::LinkIdentity> identity = std::nullopt,
                        const std::optional<telemetry::LinkKey>& key = std::nullopt)
      : link_(identity, key) {}

  // Takes one modem frame received at `utc_ns`; calls `each` with every link frame in it and its verdict.
  // True: at least one was accepted.
  using Each = std::function<void(const telemetry::DecodedFrame&, std::span<const std::uint8_t>)>;
  bool receive(std::span<const std::uint8_t> modem_frame, std::int64_t utc_ns, const Each& each = {});
  // Takes one link frame received at `utc_ns` and returns its verdict.
  telemetry::DecodedFrame accept(std::span<const std::uint8_t> bytes, std::int64_t utc_ns);

  // Accepted frames before the next one are lost from the ship's file; see LinkReceiver.
  void noteDamage() { link_.noteDamage(); }

  // Queues a request for the ship's next turn; false: out of bounds, too many wait, or the vehicle is not
  // known yet.
  [[nodiscard]] bool ask(const telemetry::Request& request, std::int64_t utc_ns);
  // Queues a position of the vehicle for the ship's next turn.
  [[nodiscard]] bool sendFix(const telemetry::UsblFixMessage& fix);
  // Writes the modem frame to send now, 0: none; see ShipLink. `kept`: whether all that was received would
  // survive a power cut.
  [[nodiscard]] std::size_t speak(std::int64_t utc_ns, std::span<std::uint8_t> out,
                                  const telemetry::ShipLink::Kept& kept = {});
  [[nodiscard]] const RequestLedger& requests() const { return requests_; }
  [[nodiscard]] const telemetry::ShipLink& link() const { return link_; }

  // Grows with every change of what the page shows.
  [[nodiscard]] std::uint64_t version() const { return version_; }
  [[nodiscard]] const telemetry::LinkReceiver& receiver() const { return link_.receiver(); }
  [[nodiscard]] const std::optional<telemetry::Status>& status() const { return status_; }
  // The newest report; for its health see health().
  [[nodiscard]] const std::optional<telemetry::StateReport>& report() const { return report_; }
  // Health of the newer of status and report (HealthFlag).
  [[nodiscard]] std::uint16_t health() const;
  [[nodiscard]] const std::optional<telemetry::MissionInfo>& mission() const { return mission_; }
  // The ship's time less the vehicle's at the newest status, its time in transit included [ns].
  [[nodiscard]] std::optional<std::int64_t> clocksApart() const { return clocks_apart_ns_; }
  [[nodiscard]] bool schemaDiffers() const;  // the sender's schema is another
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
  // UTC converted to the vehicle's clock when the two clocks disagree, so that the vehicle takes the ship's
  // frames as recent.
  [[nodiscard]] std::int64_t vehicleTime(std::int64_t utc_ns) const;
  [[nodiscard]] bool take(const telemetry::LinkReceiver::Message& message, std::int64_t utc_ns);
  // Drops what was received of an earlier dive, or before the vehicle restarted its numbers.
  void followBeginning();
  void addTrack(std::int64_t utc_ns, const TrackRecord& record);
  // Whether a status is current: its time is within a day of the ship's, or as far from it as the status
  // before. So an undetected damaged status is not shown, and a clock that is years off costs one status.
  [[nodiscard]] bool isOfNow(const telemetry::Status& status, std::int64_t utc_ns);
  // Whether a point of the track is of the present dive, by the status's time.
  [[nodiscard]] bool isOfDive(std::int64_t point_utc_ns) const;

  static constexpr std::int64_t kClocksAgree_ns = 60'000'000'000;  // longer than any frame is in transit
  static constexpr std::int64_t kOfNow_ns = 86'400'000'000'000;    // far later than any frame
  static constexpr std::int64_t kAsBefore_ns = 600'000'000'000;    // frames may be minutes late
  static constexpr std::int64_t kLongestDive_ns = 2 * kOfNow_ns;
  static constexpr std::size_t kMaxTrack = 100'000;  // 5 h at 5 Hz; beyond, the oldest go

  telemetry::ShipLink link_;
  RequestLedger requests_;
  telemetry::TileReassembler reassembler_;
  ReceivedMap map_;
  std::optional<telemetry::Status> status_;
  std::optional<telemetry::StateReport> report_;
  telemetry::Version began_ = 0, status_version_ = 0, report_version_ = 0, mission_version_ = 0;
  std::optional<telemetry::MissionInfo> mission_;
  Track track_;
  LinkHistory history_;
  std::optional<std::int64_t> last_accepted_utc_ns_, clocks_apart_ns_;
  std::optional<std::int64_t> last_apart_ns_;  // of the last status, current or not
  std::uint64_t version_ = 0, track_version_ = 0;
};

}  // namespace fathom::monitor
