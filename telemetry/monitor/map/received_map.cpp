#include "telemetry/monitor/map/received_map.hpp"

#include <optional>

namespace fathom::monitor {

using telemetry::BlockKey;
using telemetry::MapBlock;

bool ReceivedMap::takePacket(std::span<const std::uint8_t> payload, telemetry::Version version,
                             std::int64_t utc_ns) {
  if (!decoder_.decode(payload, packet_)) return false;
  ++packets_;
  for (const MapBlock& block : packet_.blocks)
    store_.put(block, {version, packet_.max_error, packet_.has_colour, utc_ns});
  return true;
}

void ReceivedMap::forgetBefore(telemetry::Version version) {
  store_.forgetBefore(version);
  revisions_.clear();
  places_.clear();
}

void ReceivedMap::takeTile(const telemetry::DecodedTile& decoded, telemetry::Version version,
                           std::int64_t utc_ns) {
  const HeightTile& tile = decoded.tile;
  const TilePlace place{tile.level, tile.north_index, tile.east_index};
  const auto revision = static_cast<std::uint16_t>(tile.revision);
  const auto [known, is_new] = revisions_.try_emplace(place, revision);
  if (is_new) {
    places_.push_back(place);
    if (places_.size() > kMaxTilePlaces) {
      revisions_.erase(places_.front());
      places_.pop_front();
    }
  } else if (known->second != revision) {
    if (!telemetry::newerRevision(revision, known->second)) {
      ++stale_tiles_;
      return;
    }
    known->second = revision;
  }
  const auto code = telemetry::spacingCode(tile.spacing() * decoded.stride);
  // A tile's last row and column belong to its neighbours.
  const int side = HeightTile::kCells / decoded.stride;
  std::map<BlockKey, MapBlock> blocks;
  for (int i = 0; i < side; ++i) {
    for (int j = 0; j < side; ++j) {
      const std::int64_t n = std::int64_t{tile.north_index} * side + i,
                         e = std::int64_t{tile.east_index} * side + j;
      const BlockKey key{code.value_or(kCoarsestCode + 1), static_cast<std::int32_t>(n >> 2),
                         static_cast<std::int32_t>(e >> 2)};
      const auto [at, fresh] = blocks.try_emplace(key);
      MapBlock& block = at->second;
      if (fresh) {
        const StoredBlock* stored = store_.find(key);
        if (stored != nullptr) block = stored->block;
        block.key = key;
      }
      const auto node = static_cast<std::size_t>((n & 3) * MapBlock::kSide + (e & 3));
      const HeightTile::Node& from = tile.at(i * decoded.stride, j * decoded.stride);
      const auto bit = static_cast<std::uint16_t>(1U << node);
      block.seen = static_cast<std::uint16_t>(from.coverage > 0 ? block.seen | bit : block.seen & ~bit);
      if (from.coverage <= 0) continue;
      block.depth[node] = from.depth;
      block.colour[node] = from.colour;
      block.sigma = from.sigma;
    }
  }
  for (const auto& [key, block] : blocks)
    if (block.seen != 0)
      store_.put(block, {version, decoded.depth_resolution / 2, decoded.colour_bits > 0, utc_ns});
}

}  // namespace fathom::monitor
