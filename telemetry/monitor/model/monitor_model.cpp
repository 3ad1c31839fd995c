#include "telemetry/monitor/model/monitor_model.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::monitor {

using telemetry::DecodedFrame;
using telemetry::FrameVerdict;
using telemetry::MessageType;

std::uint64_t MonitorModel::accepted(MessageType type) const {
  return receiver().counters().types[static_cast<std::size_t>(type)];
}

bool MonitorModel::schemaDiffers() const {
  return mission_ && mission_->schema_hash != telemetry::schemaHash();
}

void MonitorModel::addTrack(std::int64_t utc_ns, const TrackRecord& record) {
  const auto [at, is_new] = track_.try_emplace(utc_ns, record);
  if (!is_new) {
    const double altitude = std::isfinite(record.altitude) ? record.altitude : at->second.altitude;
    at->second = record;
    at->second.altitude = altitude;
  }
  if (track_.size() > kMaxTrack) track_.erase(track_.begin());
  ++track_version_;
}

void MonitorModel::confirm(std::optional<std::uint8_t> request_id) {
  if (request_id && link_.sender() != nullptr) link_.sender()->confirm(*request_id);
}

bool MonitorModel::take(const telemetry::LinkReceiver::Message& message, std::int64_t utc_ns) {
  const auto& [type, version, payload] = message;
  // A message that comes late must not take the vehicle back.
  const auto isNewer = [version = version](telemetry::Version& newest) {
    const bool newer = version >= newest;
    newest = std::max(newest, version);
    return newer;
  };
  switch (type) {
    case MessageType::kStatus: {
      telemetry::Status status;
      if (!telemetry::decodeStatus(payload, status)) return false;
      // Its position belongs to the track, however late.
      addTrack(status.utc_ns, {status.north, status.east, status.depth, status.altitude});
      if (isNewer(status_version_)) {
        status_ = status;
        clocks_apart_ns_ = utc_ns - status.utc_ns;
      }
      confirm(requests_.noteStatus(status.utc_ns, utc_ns));
      return true;
    }
    case MessageType::kTrack: {
      std::array<telemetry::TrackPoint, telemetry::kMaxTrackPoints> points;
      const std::size_t count = telemetry::decodeTrack(payload, points);
      for (std::size_t i = 0; i < count; ++i)
        addTrack(points[i].utc_ns, {points[i].north, points[i].east, points[i].depth, telemetry::kAbsent});
      return count > 0;
    }
    case MessageType::kMissionInfo: {
      telemetry::MissionInfo info;
      if (!telemetry::decodeMissionInfo(payload, info)) return false;
      if (isNewer(mission_version_)) mission_ = info;
      return true;
    }
    case MessageType::kMapPacket:
      if (!map_.takePacket(payload, version, utc_ns)) return false;
      for (const telemetry::MapBlock& block : map_.lastBlocks())
        confirm(requests_.noteBlock(block.key, utc_ns));
      return true;
    case MessageType::kTileFragment: {
      telemetry::DecodedTile tile;
      const auto invalid = reassembler_.counters().invalid;
      if (reassembler_.accept(payload, tile)) map_.takeTile(tile, version, utc_ns);
      return reassembler_.counters().invalid == invalid;
    }
    case MessageType::kRepair:
    case MessageType::kDownlink:
      return false;  // the receiver keeps these to itself
  }
  return false;
}

DecodedFrame MonitorModel::accept(std::span<const std::uint8_t> bytes, std::int64_t utc_ns) {
  const DecodedFrame frame =
      link_.accept(utc_ns, bytes, [&](const auto& message) { return take(message, utc_ns); });
  ++version_;
  const bool accepted = frame.verdict == FrameVerdict::kAccepted;
  history_.add(utc_ns, bytes.size(), accepted, receiver().counters().lost);
  if (accepted) last_accepted_utc_ns_ = utc_ns;
  return frame;
}

bool MonitorModel::ask(const telemetry::Request& request, std::int64_t utc_ns) {
  telemetry::DownlinkSender* sender = link_.sender();
  const auto id = sender == nullptr ? std::nullopt : sender->request(request);
  if (!id) return false;
  telemetry::Request named = request;
  named.id = *id;
  requests_.add(named, utc_ns);
  ++version_;
  return true;
}

bool MonitorModel::tellFix(const telemetry::UsblFixMessage& fix) {
  telemetry::DownlinkSender* sender = link_.sender();
  telemetry::UsblFixMessage said = fix;
  said.utc_ns = vehicleTime(fix.utc_ns);
  return sender != nullptr && sender->addFix(said);
}

std::int64_t MonitorModel::vehicleTime(std::int64_t utc_ns) const {
  const std::int64_t apart_ns = clocks_apart_ns_.value_or(0);
  return std::abs(apart_ns) > kClocksAgree_ns ? utc_ns - apart_ns : utc_ns;
}

std::size_t MonitorModel::speak(std::int64_t utc_ns, std::span<std::uint8_t> out,
                                const telemetry::ShipLink::Kept& kept) {
  const std::size_t size = link_.nextFrame(utc_ns, vehicleTime(utc_ns), out, kept);
  if (size == 0) return 0;
  requests_.noteSent(out.first(size), utc_ns);
  ++version_;
  return size;
}

}  // namespace fathom::monitor
