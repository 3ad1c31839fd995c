#include "telemetry/monitor/model/monitor_model.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "telemetry/wire/frame.hpp"

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

bool MonitorModel::isOfNow(const telemetry::Status& status, std::int64_t utc_ns) {
  const std::int64_t apart_ns = utc_ns - status.utc_ns;
  const bool as_before = last_apart_ns_ && std::abs(apart_ns - *last_apart_ns_) <= kAsBefore_ns;
  last_apart_ns_ = apart_ns;
  return std::abs(apart_ns) <= kOfNow_ns || as_before;
}

bool MonitorModel::isOfDive(std::int64_t point_utc_ns) const {
  return !status_ || (point_utc_ns <= status_->utc_ns + kAsBefore_ns &&
                      point_utc_ns >= status_->utc_ns - kLongestDive_ns);
}

std::uint16_t MonitorModel::health() const {
  if (report_ && report_version_ > status_version_) return report_->health;
  return status_ ? status_->health : std::uint16_t{0};
}

void MonitorModel::followBeginning() {
  const telemetry::Version began = receiver().began();
  if (began == began_) return;
  if (began_ != 0) {
    map_.forgetBefore(began);
    track_.clear();
    ++track_version_;
    status_.reset();
    report_.reset();
    mission_.reset();
    status_version_ = report_version_ = mission_version_ = 0;
    clocks_apart_ns_.reset();
  }
  began_ = began;
}

bool MonitorModel::take(const telemetry::LinkReceiver::Message& message, std::int64_t utc_ns) {
  followBeginning();
  const auto& [type, version, payload] = message;
  // A late message must not replace a newer one.
  const auto isNewer = [version = version](telemetry::Version& newest) {
    const bool newer = version >= newest;
    newest = std::max(newest, version);
    return newer;
  };
  switch (type) {
    case MessageType::kStatus: {
      telemetry::Status status;
      if (!telemetry::decodeStatus(payload, status)) return false;
      if (!isOfNow(status, utc_ns)) return true;
      // Its position belongs to the track, however late.
      addTrack(status.utc_ns, {status.north, status.east, status.depth, status.altitude});
      if (isNewer(status_version_)) {
        status_ = status;
        clocks_apart_ns_ = utc_ns - status.utc_ns;
      }
      return true;
    }
    case MessageType::kReport: {
      telemetry::StateReport report;
      if (!telemetry::decodeStateReport(payload, report)) return false;
      if (!isNewer(report_version_)) return true;
      report_ = report;
      requests_.noteReport(report, utc_ns, [this](std::uint8_t id) {
        if (link_.sender() != nullptr) link_.sender()->confirm(id);
      });
      return true;
    }
    case MessageType::kTrack: {
      std::array<telemetry::TrackPoint, telemetry::kMaxTrackPoints> points;
      const std::size_t count = telemetry::decodeTrack(payload, points);
      for (std::size_t i = 0; i < count; ++i)
        if (isOfDive(points[i].utc_ns))
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
      return map_.takePacket(payload, version, utc_ns);
    case MessageType::kTileFragment: {
      telemetry::DecodedTile tile;
      const auto invalid = reassembler_.counters().invalid;
      if (reassembler_.accept(payload, tile)) map_.takeTile(tile, version, utc_ns);
      return reassembler_.counters().invalid == invalid;
    }
    case MessageType::kRepair:
    case MessageType::kDownlink:
      return false;  // handled by the receiver
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

bool MonitorModel::receive(std::span<const std::uint8_t> modem_frame, std::int64_t utc_ns, const Each& each) {
  return link_.receive(modem_frame, [&](std::span<const std::uint8_t> link_frame) {
    const DecodedFrame frame = accept(link_frame, utc_ns);
    if (each) each(frame, link_frame);
    return frame.verdict == FrameVerdict::kAccepted;
  });
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

bool MonitorModel::sendFix(const telemetry::UsblFixMessage& fix) {
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
  // Requests sent for the last time had until this turn to be reported.
  requests_.noteGivenUp(utc_ns, [this](std::uint8_t id) { return link_.sender()->waits(id); });
  telemetry::LinkFrames said(out.first(size));
  while (const auto frame = said.next()) requests_.noteSent(*frame, utc_ns);
  ++version_;
  return size;
}

}  // namespace fathom::monitor
