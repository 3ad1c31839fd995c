#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <span>

#include "telemetry/map/map_packet.hpp"
#include "telemetry/monitor/map/block_store.hpp"
#include "telemetry/tiles/tile_fragments.hpp"

namespace fathom::monitor {

// The map of a dive from both codecs: packets of blocks, and whole tiles (requested detail on fast links).
class ReceivedMap {
 public:
  explicit ReceivedMap(std::size_t max_blocks = BlockStore::kDefaultBlocks) : store_(max_blocks) {}

  // Takes the payload of a map packet of frame `version`; false if it is none.
  [[nodiscard]] bool takePacket(std::span<const std::uint8_t> payload, telemetry::Version version,
                                std::int64_t utc_ns);
  // Puts a tile's nodes into the blocks of their spacing. A tile older than the newest of its place is
  // ignored.
  void takeTile(const telemetry::DecodedTile& tile, telemetry::Version version, std::int64_t utc_ns);

  // See BlockStore.
  void forgetBefore(telemetry::Version version);

  [[nodiscard]] const BlockStore& store() const { return store_; }
  [[nodiscard]] std::uint64_t version() const { return store_.version(); }
  [[nodiscard]] std::uint64_t packets() const { return packets_; }
  [[nodiscard]] std::uint64_t staleTiles() const { return stale_tiles_; }

 private:
  struct TilePlace {
    int level;
    std::int32_t north, east;
    friend auto operator<=>(const TilePlace&, const TilePlace&) = default;
  };
  static constexpr std::size_t kMaxTilePlaces = 20000;

  BlockStore store_;
  telemetry::MapPacketDecoder decoder_;
  telemetry::DecodedMapPacket packet_;
  std::map<TilePlace, std::uint16_t> revisions_;  // the newest of each place
  std::deque<TilePlace> places_;                  // oldest first
  std::uint64_t packets_ = 0, stale_tiles_ = 0;
};

}  // namespace fathom::monitor
