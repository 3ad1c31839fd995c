#pragma once

#include <map>
#include <set>

#include "realtime/base/units.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/ship/link_receiver.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"
#include "tests/telemetry/sample_frames.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::telemetry {

// Of tests with an answering ship.
inline LinkSchedulerConfig someConfig(int frame_bytes = 64, double rate_bps = 2000) {
  LinkSchedulerConfig config;
  config.identity = kOurs;
  config.rate_bps = rate_bps;
  config.frame_bytes = frame_bytes;
  config.max_delay_s = 0.2;
  config.colour_bits = 0;
  config.blocks.coarse_spacing = config.blocks.spacing;
  config.blocks.settle_s = 0;
  return config;
}

// The ship: what it holds of the map, its receiver and clock, and the chance that loses frames.
struct Ship {
  std::int64_t now = kStart_ns;
  std::mt19937 random{4};
  LinkReceiver receiver;
  MapPacketDecoder decoder;
  DecodedMapPacket packet;
  std::map<BlockKey, MapBlock> map;
  StateReport report;
  std::uint16_t health = 0;
  std::set<std::int64_t> track;  // times of the points received

  void receive(std::span<const std::uint8_t> frame) {
    receiver.accept(frame, [&](const LinkReceiver::Message& message) {
      Status status;
      if (message.type == MessageType::kReport && decodeStateReport(message.payload, report))
        health = report.health;
      if (message.type == MessageType::kStatus && decodeStatus(message.payload, status))
        health = status.health;
      std::array<TrackPoint, kMaxTrackPoints> points;
      if (message.type == MessageType::kTrack)
        for (std::size_t k = 0, count = decodeTrack(message.payload, points); k < count; ++k)
          track.insert(points[k].utc_ns);
      if (message.type != MessageType::kMapPacket) return true;
      if (!decoder.decode(message.payload, packet)) return false;
      for (const MapBlock& block : packet.blocks) map[block.key] = block;
      return true;
    });
  }
  // Nodes shown of the squares in that row.
  int shown(std::int32_t north) const {
    int count = 0;
    for (const auto& [key, block] : map) count += key.north >> 2 == north ? std::popcount(block.seen) : 0;
    return count;
  }
  // Greatest difference to a tile's nodes; infinite where one is missing.
  double error(const HeightTile& tile) const {
    double worst = 0;
    for (int i = 0; i < HeightTile::kCells; ++i)
      for (int j = 0; j < HeightTile::kCells; ++j) {
        if (tile.at(i, j).coverage == 0) continue;
        const auto found = map.find(
            {*spacingCode(tile.spacing()), tile.north_index * 4 + i / 4, tile.east_index * 4 + j / 4});
        const auto n = static_cast<std::size_t>(i % 4 * 4 + j % 4);
        if (found == map.end() || !found->second.isSeen(static_cast<int>(n))) return INFINITY;
        worst = std::max(worst, std::abs(static_cast<double>(found->second.depth[n] - tile.at(i, j).depth)));
      }
    return worst;
  }
  // Sends for so long; frames are lost by chance, turns are answered at once unless the answer is lost too.
  void converse(LinkScheduler& scheduler, double seconds, double loss, bool answers = true) {
    std::array<std::uint8_t, kMaxFrameBytes> buffer;
    const auto lost = [&] { return random() < loss * 4294967296.0; };
    for (const std::int64_t end = now + std::llround(seconds * 1e9); now < end; now += kSecond_ns / 5)
      while (const std::size_t size = scheduler.nextFrame(now, buffer)) {
        const auto frame = std::span<const std::uint8_t>(buffer).first(size);
        if (lost()) continue;
        receive(frame);
        if (answers && receiver.turn() && !lost()) scheduler.acknowledge(receiver.acknowledgement(), now);
      }
  }
};

}  // namespace fathom::telemetry
