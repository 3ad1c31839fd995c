#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <unordered_map>

#include "telemetry/map/map_packet.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::monitor {

// A chunk is a square of 16 m of seafloor: meshed, sent to the page and drawn as a whole. Positions inside
// the store are whole units of the finest lattice of the link (7.8 mm); the lattices of all powers of two
// nest in them.
using Unit = std::int32_t;
inline constexpr int kUnitsPerMetre = 128;
inline constexpr int kCoarsestCode = 9;  // 4 m, so that a block of 4 x 4 nodes is inside one chunk
inline constexpr int kLevels = kCoarsestCode + 1;
inline constexpr int kChunkCode = 11;  // a chunk is one cell of 16 m
inline constexpr Unit kChunkUnits = 1 << kChunkCode;
inline constexpr double kChunkSize_m = 16;
inline constexpr double kMaxHorizontal_m = 52428.7;              // bound of positions in the status
inline constexpr double kMinDepth_m = -50, kMaxDepth_m = 12000;  // bounds of seafloor

struct ChunkKey {
  std::int32_t north = 0, east = 0;
  friend auto operator<=>(const ChunkKey&, const ChunkKey&) = default;
};

struct StoredBlock {
  telemetry::MapBlock block;
  bool has_colour = false;
  float max_error = 0;               // error bound of the sender [m]
  telemetry::Version version = 0;    // of the frame that carried it
  std::int64_t received_utc_ns = 0;  // of this content
  std::int64_t changed_utc_ns = 0;   // when its heights last changed; 0: never
};

// The map as received: of every block the content of the newest frame, in any order of arrival. Bounded: when
// full it evicts the oldest block of the finest spacing, so that the map loses resolution before it loses
// area, and counts it. A copy is cheap: it shares the chunks until either changes them. Another thread may
// read a copy; copies are created and replaced while the original does not change.
class BlockStore {
 public:
  static constexpr std::size_t kDefaultBlocks = 65536;  // 10 times a 7,500 m2 dive at 25 cm
  explicit BlockStore(std::size_t max_blocks = kDefaultBlocks) : max_blocks_(max_blocks) {}

  // The frame that brought a block.
  struct Origin {
    telemetry::Version version = 0;  // of the frame
    double max_error = 0;            // error bound of the sender [m]
    bool has_colour = false;
    std::int64_t utc_ns = 0;  // when it was received
  };
  // Stores a block. One without seen nodes withdraws the stored block of its place. A block older than the
  // stored or withdrawn one is ignored. False for a block that cannot be shown: a spacing that is no power of
  // two up to 4 m, or a place or depth out of bounds.
  bool put(const telemetry::MapBlock& block, const Origin& origin);

  // Removes all blocks of frames before this one: they are of another map.
  void forgetBefore(telemetry::Version version);

  struct Chunk {
    // Of each spacing code, by chunkSlot().
    std::array<std::unordered_map<std::uint32_t, StoredBlock>, kLevels> levels;
    std::uint64_t version = 0;  // of the store at the last change in the chunk or near its border
  };
  using Chunks = std::map<ChunkKey, std::shared_ptr<const Chunk>>;
  [[nodiscard]] const Chunks& chunks() const { return chunks_; }
  [[nodiscard]] const Chunk* chunk(ChunkKey key) const;
  [[nodiscard]] const StoredBlock* find(const telemetry::BlockKey& key) const;

  [[nodiscard]] static ChunkKey chunkOf(const telemetry::BlockKey& key);
  [[nodiscard]] static std::uint32_t chunkSlot(const telemetry::BlockKey& key);

  [[nodiscard]] std::uint64_t version() const { return version_; }
  // Grows when a chunk leaves the store: a reader that follows by versions must then read everything again.
  [[nodiscard]] std::uint64_t generation() const { return generation_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t size(telemetry::SpacingCode code) const { return counts_.at(code); }

  struct Counters {
    std::uint64_t taken = 0;
    std::uint64_t refused = 0;    // see put()
    std::uint64_t stale = 0;      // older than the stored block
    std::uint64_t replaced = 0;   // blocks received again
    std::uint64_t changed = 0;    // of those, with heights that differ beyond both error bounds and 5 cm
    std::uint64_t withdrawn = 0;  // blocks removed because nothing is seen there any more
    std::uint64_t evicted = 0;    // dropped because the store was full
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  // The chunk for changing it, copied first if a copy of the store shares it.
  [[nodiscard]] static Chunk& own(std::shared_ptr<const Chunk>& held);
  void touch(const telemetry::BlockKey& key);
  void evict();
  void remove(const telemetry::BlockKey& key);
  [[nodiscard]] bool isStale(const telemetry::BlockKey& key, telemetry::Version version) const;
  void noteWithdrawn(const telemetry::BlockKey& key, telemetry::Version version);

  // Enough for the frames that the receiver's window admits late.
  static constexpr std::size_t kMaxWithdrawn = 65536;
  std::size_t max_blocks_;
  Chunks chunks_;
  std::array<std::size_t, kLevels> counts_{};
  std::array<std::deque<telemetry::BlockKey>, kLevels> arrivals_;  // each stored block once, oldest first
  std::map<telemetry::BlockKey, telemetry::Version> withdrawn_;    // by which frame
  std::size_t size_ = 0;
  std::uint64_t version_ = 0, generation_ = 0;
  Counters counters_;
};

}  // namespace fathom::monitor
