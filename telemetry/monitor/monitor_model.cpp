#include "telemetry/monitor/monitor_model.hpp"

namespace fathom::monitor {

using telemetry::DecodedFrame;
using telemetry::FrameVerdict;
using telemetry::MessageType;

namespace {
constexpr std::int64_t kMinute_ns = 60'000'000'000;
}

std::uint64_t MonitorModel::accepted(MessageType type) const {
  return receiver_.counters().types[static_cast<std::size_t>(type)];
}

bool MonitorModel::schemaDiffers() const {
  return mission_ && mission_->schema_hash != telemetry::schemaHash();
}

void MonitorModel::addTrack(const telemetry::TrackPoint& point) {
  track_.insert_or_assign(point.utc_ns, point);
  if (track_.size() > kMaxTrack) track_.erase(track_.begin());
}

bool MonitorModel::take(MessageType type, std::span<const std::uint8_t> payload, std::int64_t utc_ns) {
  switch (type) {
    case MessageType::kStatus: {
      telemetry::Status status;
      if (!telemetry::decodeStatus(payload, status)) return false;
      // A frame that comes late must not take the vehicle back; its position still belongs to the track.
      addTrack({status.utc_ns, status.north, status.east, status.depth});
      if (!status_ || status.utc_ns >= status_->utc_ns) status_ = status;
      return true;
    }
    case MessageType::kTrack: {
      std::array<telemetry::TrackPoint, telemetry::kMaxTrackPoints> points;
      const std::size_t count = telemetry::decodeTrack(payload, points);
      for (std::size_t i = 0; i < count; ++i) addTrack(points[i]);
      return count > 0;
    }
    case MessageType::kMissionInfo: {
      telemetry::MissionInfo info;
      if (!telemetry::decodeMissionInfo(payload, info)) return false;
      mission_ = info;
      return true;
    }
    case MessageType::kTileFragment: {
      telemetry::DecodedTile tile;
      const auto invalid = reassembler_.counters().invalid;
      if (reassembler_.accept(payload, tile)) map_.put(tile, utc_ns);
      return reassembler_.counters().invalid == invalid;
    }
    case MessageType::kMapPacket:
      return map_packets_.decode(payload, packet_);
    case MessageType::kRepair:
    case MessageType::kDownlink:
      return false;  // the receiver keeps these to itself
  }
  return false;
}

DecodedFrame MonitorModel::accept(std::span<const std::uint8_t> bytes, std::int64_t utc_ns) {
  const DecodedFrame frame = receiver_.accept(
      bytes,
      [&](MessageType type, std::span<const std::uint8_t> payload) { return take(type, payload, utc_ns); });
  ++version_;
  if (frame.verdict != FrameVerdict::kAccepted) return frame;
  last_accepted_utc_ns_ = utc_ns;
  recent_.push_back({utc_ns, bytes.size()});
  while (recent_.size() > kMaxRecent || recent_.front().utc_ns < utc_ns - kMinute_ns) recent_.pop_front();
  return frame;
}

double MonitorModel::recentRateBps(std::int64_t now_ns) const {
  double bits = 0;
  for (const Arrival& a : recent_)
    if (a.utc_ns > now_ns - kMinute_ns) bits += static_cast<double>(a.bytes) * 8;
  return bits / 60;
}

}  // namespace fathom::monitor
