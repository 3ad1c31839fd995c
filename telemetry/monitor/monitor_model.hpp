#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <span>

#include "telemetry/link_receiver.hpp"
#include "telemetry/map_packet.hpp"
#include "telemetry/mission_info.hpp"
#include "telemetry/monitor/tile_store.hpp"
#include "telemetry/status.hpp"
#include "telemetry/tile_fragments.hpp"
#include "telemetry/track.hpp"

namespace fathom::monitor {

// What the ship knows of a dive: status, track and map, from frames in any state. Sans-I/O; bounded whatever
// arrives. Only whole frames of one vehicle and dive enter, each once.
class MonitorModel {
 public:
  explicit MonitorModel(std::optional<telemetry::LinkIdentity> identity = std::nullopt)
      : receiver_(identity) {}

  // Takes one frame as received at `utc_ns`; says what became of it.
  telemetry::DecodedFrame accept(std::span<const std::uint8_t> bytes, std::int64_t utc_ns);

  // Grows with everything that changes what is to be shown.
  [[nodiscard]] std::uint64_t version() const { return version_; }
  [[nodiscard]] const telemetry::LinkReceiver& receiver() const { return receiver_; }
  [[nodiscard]] const std::optional<telemetry::Status>& status() const { return status_; }
  [[nodiscard]] const std::optional<telemetry::MissionInfo>& mission() const { return mission_; }
  [[nodiscard]] bool schemaDiffers() const;  // the sender's fields are not ours
  [[nodiscard]] const TileStore& map() const { return map_; }
  [[nodiscard]] const telemetry::TileReassembler& reassembler() const { return reassembler_; }
  // Track points by time, status positions included.
  [[nodiscard]] const std::map<std::int64_t, telemetry::TrackPoint>& track() const { return track_; }
  // Accepted frames by message type.
  [[nodiscard]] std::uint64_t accepted(telemetry::MessageType type) const;
  [[nodiscard]] std::optional<std::int64_t> lastAcceptedUtcNs() const { return last_accepted_utc_ns_; }
  // Bits per second of accepted frames in the minute before `now_ns`.
  [[nodiscard]] double recentRateBps(std::int64_t now_ns) const;

 private:
  [[nodiscard]] bool take(telemetry::MessageType type, std::span<const std::uint8_t> payload,
                          std::int64_t utc_ns);
  void addTrack(const telemetry::TrackPoint& point);

  static constexpr std::size_t kMaxTrack = 200'000;  // 5 h at 10 Hz; beyond, the oldest go
  static constexpr std::size_t kMaxRecent = 4096;

  telemetry::LinkReceiver receiver_;
  telemetry::MapPacketDecoder map_packets_;
  telemetry::DecodedMapPacket packet_;
  telemetry::TileReassembler reassembler_;
  TileStore map_;
  std::optional<telemetry::Status> status_;
  std::optional<telemetry::MissionInfo> mission_;
  std::map<std::int64_t, telemetry::TrackPoint> track_;
  std::optional<std::int64_t> last_accepted_utc_ns_;
  struct Arrival {
    std::int64_t utc_ns;
    std::size_t bytes;
  };
  std::deque<Arrival> recent_;
  std::uint64_t version_ = 0;
};

}  // namespace fathom::monitor
