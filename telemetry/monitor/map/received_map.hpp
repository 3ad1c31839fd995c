#pragma once

#include <cstdint>
#include <cstring>
#include <deque>
#include <map>
#include <span>
#include <string>

#include "telemetry/map/map_packet.hpp"
#include "telemetry/monitor/map/block_store.hpp"
#include "telemetry/monitor/map/surface.hpp"
#include "telemetry/tiles/tile_codec.hpp"

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
  std::uint64_t packets_ = 0;
};

inline constexpr std::size_t kMaxStreamBytes =
    1 << 20;  // then the next call continues, so that a page stays responsive

// The chunks that changed after version `since`, oldest change first, for the page (decoded by
// page/src/chunks.ts). Little-endian: "FMAP", u32 map version of the reader after taking this (less than the
// store's if kMaxStreamBytes cut it short), u32 number of chunks, u32 0, f64 UTC [s] that times are counted
// from; then for each chunk i32 north and i32 east index, u32 vertices, u32 triangles, f32 area [m2], u32 0;
// and row after row, each padded to four bytes,
//   u16 north, u16 east of every vertex, in units of 1/128 m from the chunk's corner
//   f32 depth [m]
//   i8 normal north, east, up (127: 1), u8 spacing code
//   u8 red, green, blue, flags (1: has colour, 2: interpolated)
//   u16 sigma [mm], u16 error bound [mm]
//   f32 received, f32 changed [s since the time above; changed: NaN for never]
//   three indices a triangle: u16, or u32 in chunks of more than 65,535 vertices.
[[nodiscard]] std::string mapBinary(const BlockStore& store, Surface& surface, std::uint64_t since,
                                    std::int64_t base_utc_ns);

// Appends a number as it is in memory: the machines this runs on are little-endian, as are the formats.
template <class T>
void appendBytes(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}

}  // namespace fathom::monitor
