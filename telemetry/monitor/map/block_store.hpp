#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <unordered_map>

#include "telemetry/map/map_block.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::monitor {

// A chunk is a square of 16 m of seafloor: what is meshed, sent to the page and drawn as one piece. Positions
// inside the store are whole units of the finest lattice that the link can name (7.8 mm); the lattices of all
// powers of two nest in them.
using Unit = std::int32_t;
inline constexpr int kUnitsPerMetre = 128;
inline constexpr int kCoarsestCode = 9;  // 4 m, so that a block of 4 x 4 nodes lies inside one chunk
inline constexpr int kLevels = kCoarsestCode + 1;
inline constexpr int kChunkCode = 11;  // a chunk is one cell of 16 m
inline constexpr Unit kChunkUnits = 1 << kChunkCode;
inline constexpr double kChunkSize_m = 16;
inline constexpr double kMaxHorizontal_m = 52428.7;              // as far as the status can name a position
inline constexpr double kMinDepth_m = -50, kMaxDepth_m = 12000;  // of anything that can be seafloor

struct ChunkKey {
  std::int32_t north = 0, east = 0;
  friend auto operator<=>(const ChunkKey&, const ChunkKey&) = default;
};

struct StoredBlock {
  telemetry::MapBlock block;
  bool has_colour = false;
  float max_error = 0;               // that the sender kept to [m]
  telemetry::Version version = 0;    // of the frame that carried it
  std::int64_t received_utc_ns = 0;  // of this content
  std::int64_t changed_utc_ns = 0;   // when its heights last gave way to others; 0: never
};

// The map as received: of every block the content of the newest frame, in whatever order they came. Bounded:
// when it is full, the oldest block of the finest spacing gives way, so that the map loses resolution before
// it loses ground; counted. A copy is cheap: it shares the chunks until one of the two changes them. Another
// thread may read it, but it is made and replaced while the original is left alone.
class BlockStore {
 public:
  static constexpr std::size_t kDefaultBlocks = 65536;  // 10 times a 7,500 m2 dive at 25 cm
  explicit BlockStore(std::size_t max_blocks = kDefaultBlocks) : max_blocks_(max_blocks) {}

  // What came with a block.
  struct Origin {
    telemetry::Version version = 0;  // of the frame
    double max_error = 0;            // that the sender kept to [m]
    bool has_colour = false;
    std::int64_t utc_ns = 0;  // when it was received
  };
  // A block of which nothing is seen says that the map has left this place: the block held goes. What is
  // older than what is held, or was withdrawn, is left. False for what cannot be shown: another spacing than
  // a power of two up to 4 m, a place or a depth that no dive has.
  bool put(const telemetry::MapBlock& block, const Origin& origin);

  // Forgets all that came with frames before this one: they are of another map.
  void forgetBefore(telemetry::Version version);

  struct Chunk {
    // Of each spacing code, by chunkSlot().
    std::array<std::unordered_map<std::uint32_t, StoredBlock>, kLevels> levels;
    std::uint64_t version = 0;  // of the store, when something in the chunk or near its border changed last
  };
  using Chunks = std::map<ChunkKey, std::shared_ptr<const Chunk>>;
  [[nodiscard]] const Chunks& chunks() const { return chunks_; }
  [[nodiscard]] const Chunk* chunk(ChunkKey key) const;
  [[nodiscard]] const StoredBlock* find(const telemetry::BlockKey& key) const;

  [[nodiscard]] static ChunkKey chunkOf(const telemetry::BlockKey& key);
  [[nodiscard]] static std::uint32_t chunkSlot(const telemetry::BlockKey& key);

  [[nodiscard]] std::uint64_t version() const { return version_; }
  // Grows when a chunk has left the store: who follows by versions begins anew.
  [[nodiscard]] std::uint64_t generation() const { return generation_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t size(telemetry::SpacingCode code) const { return counts_.at(code); }

  struct Counters {
    std::uint64_t taken = 0;
    std::uint64_t refused = 0;    // see put()
    std::uint64_t stale = 0;      // older than what is held
    std::uint64_t replaced = 0;   // blocks received again
    std::uint64_t changed = 0;    // of those, with heights that differ beyond both error bounds and 5 cm
    std::uint64_t withdrawn = 0;  // blocks that went because nothing is seen there any more
    std::uint64_t evicted = 0;    // dropped because the store was full
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  // To change: one that no copy shares.
  [[nodiscard]] static Chunk& own(std::shared_ptr<const Chunk>& held);
  void touch(const telemetry::BlockKey& key);
  void evict();
  void remove(const telemetry::BlockKey& key);
  [[nodiscard]] bool isStale(const telemetry::BlockKey& key, telemetry::Version version) const;
  void noteWithdrawn(const telemetry::BlockKey& key, telemetry::Version version);

  // Older frames do not come later than the receiver's window lets them.
  static constexpr std::size_t kMaxWithdrawn = 65536;
  std::size_t max_blocks_;
  Chunks chunks_;
  std::array<std::size_t, kLevels> counts_{};
  std::array<std::deque<telemetry::BlockKey>, kLevels> arrivals_;  // each held block once, oldest first
  std::map<telemetry::BlockKey, telemetry::Version> withdrawn_;    // by which frame
  std::size_t size_ = 0;
  std::uint64_t version_ = 0, generation_ = 0;
  Counters counters_;
};

}  // namespace fathom::monitor
