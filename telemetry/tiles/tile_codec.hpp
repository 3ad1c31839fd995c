#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "recon/geometry/height_tile.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// Small integers through Draco's sequential point-cloud coder (difference prediction, rANS): `count` points
// of `components` values, interleaved, each 0 to 32767 and the least of all 0. The 26 bytes that are the same
// in every such stream or follow from the caller's counts are not sent, so that hostile bytes cannot choose
// the memory of decoding. Draco allocates; best-effort tier only.
inline constexpr std::size_t kMaxDracoPoints = 289;
inline constexpr int kMaxDracoComponents = 4;

// Fills all of `values`; false if the bytes are not such a stream.
[[nodiscard]] bool decodeValues(std::span<const std::uint8_t> bytes, int components,
                                std::span<std::int16_t> values);

inline constexpr std::size_t kMaxTileBytes = 4096;  // an encoded tile is never longer

inline constexpr unsigned kStrideBits = 2;  // of log2 of a stride

// A tile as it arrives. Nodes that were not sent have coverage 0; sent ones 1, and the tile's median sigma.
struct DecodedTile {
  HeightTile tile;
  int stride = 1;               // nodes on multiples of stride only
  double depth_resolution = 0;  // [m]
  int colour_bits = 0;          // 0: no colours
};

// Decodes a tile as earlier versions of the vehicle sent it: every stride-th node (1, 2, 4 or 8), lossless in
// which nodes, depth rounded to the resolution, colour to the bits. The bytes may be anything; false if they
// are not a tile. Fills all of `out` but the tile's
// indices, level and revision (those travel with each fragment). Memory used is bounded by the lattice, not
// by the bytes.
[[nodiscard]] bool decodeTile(std::span<const std::uint8_t> bytes, DecodedTile& out);

// The tile, revision and stride that a fragment belongs to.
struct FragmentTile {
  std::int32_t north_index = 0, east_index = 0;
  int level = 0;               // 0 to 15
  std::uint16_t revision = 0;  // the lower kRevisionBits of HeightTile::revision
  int stride = 1;              // 1, 2, 4 or 8
  friend bool operator==(const FragmentTile&, const FragmentTile&) = default;
  [[nodiscard]] bool sameTile(const FragmentTile& o) const {
    return north_index == o.north_index && east_index == o.east_index && level == o.level;
  }
};

// A fragment's payload: 8 bytes (u4 level, s15 north index, s15 east index, u14 revision, u2 stride, u7
// fragment, u7 number of fragments) and a piece of the encoded tile. Every piece but the last has the same
// length.
inline constexpr std::size_t kFragmentHeaderBytes = 8;
inline constexpr int kMaxFragments = 127;
inline constexpr unsigned kRevisionBits = 14;
inline constexpr std::size_t kMaxPieceBytes = kMaxFrameBytes - kFrameOverhead - kFragmentHeaderBytes;

struct TileFragment {
  FragmentTile id;
  int index = 0, count = 0;
  std::span<const std::uint8_t> piece;
};

[[nodiscard]] bool decodeFragment(std::span<const std::uint8_t> payload, TileFragment& out);

// True if revision a is newer than b (serial numbers that wrap, RFC 1982).
[[nodiscard]] bool newerRevision(std::uint16_t a, std::uint16_t b);

// Reassembles tiles from fragments in any order, repeated or missing. A fixed number of tiles may be open;
// when full, the one that has waited longest for a fragment is evicted and counted. A newer revision drops
// the open older ones of the same tile and stride.
class TileReassembler {
 public:
  explicit TileReassembler(int open_tiles = 64);

  // Takes a fragment's payload. True when it completed a tile, now in `out`.
  bool accept(std::span<const std::uint8_t> payload, DecodedTile& out);

  struct Counters {
    std::uint64_t fragments = 0;    // valid ones
    std::uint64_t invalid = 0;      // not a fragment
    std::uint64_t repeated = 0;     // received already, or of a tile just completed
    std::uint64_t conflicting = 0;  // count or length disagree with the tile's other fragments
    std::uint64_t completed = 0;
    std::uint64_t undecodable = 0;  // complete, but not a tile
    std::uint64_t superseded = 0;   // dropped for a newer revision
    std::uint64_t evicted = 0;      // dropped because too many tiles were open
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] int open() const;

 private:
  struct Slot {
    bool used = false, finished = false;  // finished: kept to recognise repeats
    FragmentTile id;
    int count = 0, have = 0;
    std::uint64_t touched = 0;
    std::array<bool, kMaxFragments> present{};
    std::array<std::uint8_t, kMaxFragments> length{};
    std::array<std::uint8_t, kMaxFragments * kMaxPieceBytes> bytes{};
  };
  Slot& slotFor(const TileFragment& fragment);
  [[nodiscard]] bool assemble(Slot& slot, DecodedTile& out);

  std::vector<Slot> slots_;
  std::uint64_t clock_ = 0;  // fragments taken
  Counters counters_;
};

}  // namespace fathom::telemetry
