#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "recon/geometry/height_tile.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

inline constexpr int kBlocksASide = 4;  // blocks per side of a square of 16 x 16 nodes

// Floor division: the index of the square that holds a block, or of the coarse block over a fine one.
[[nodiscard]] constexpr std::int32_t floorDiv(std::int32_t a, std::int32_t b) {
  return a / b - (a % b != 0 && (a < 0) != (b < 0) ? 1 : 0);
}

// Finds a square's slot by its lattice's spacing and its index north and east: open addressing in a table
// that is sized once and at most half full with the `capacity` entries that the caller keeps to.
class SquareIndex {
 public:
  explicit SquareIndex(std::size_t capacity) {
    std::size_t size = 16;
    while (size < 2 * capacity) size *= 2;
    table_.assign(size, Entry{});
  }
  [[nodiscard]] std::optional<std::size_t> find(SpacingCode spacing, std::int32_t north,
                                                std::int32_t east) const {
    const std::uint64_t key = pack(spacing, north, east);
    for (std::size_t at = home(key); table_[at].slot >= 0; at = (at + 1) % table_.size())
      if (table_[at].key == key) return static_cast<std::size_t>(table_[at].slot);
    return std::nullopt;
  }
  void add(SpacingCode spacing, std::int32_t north, std::int32_t east, std::size_t slot) {
    const std::uint64_t key = pack(spacing, north, east);
    std::size_t at = home(key);
    while (table_[at].slot >= 0) at = (at + 1) % table_.size();
    table_[at] = {key, static_cast<std::int32_t>(slot)};
  }
  void clear() { std::fill(table_.begin(), table_.end(), Entry{}); }
  [[nodiscard]] std::size_t memoryBytes() const { return table_.size() * sizeof(Entry); }

 private:
  struct Entry {
    std::uint64_t key = 0;
    std::int32_t slot = -1;
  };
  static std::uint64_t pack(SpacingCode spacing, std::int32_t north, std::int32_t east) {
    constexpr std::uint64_t kMask = (1U << 24) - 1;  // 16 million squares in each direction
    return std::uint64_t{spacing} << 48 | (static_cast<std::uint64_t>(north) & kMask) << 24 |
           (static_cast<std::uint64_t>(east) & kMask);
  }
  [[nodiscard]] std::size_t home(std::uint64_t key) const {
    key *= 0x9e3779b97f4a7c15ULL;  // Fibonacci hashing: neighbours land far apart
    return static_cast<std::size_t>(key >> 32) % table_.size();
  }
  std::vector<Entry> table_;
};

// Throws std::invalid_argument(what) for a value of a configuration that is out of its bounds.
inline void requireBounds(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

struct BlockQueueConfig {
  int max_squares = 1024;     // pool
  double spacing = 0.25;      // of the lattice that every area gets [m]
  double coarse_spacing = 1;  // of coarse blocks, sent where fine ones are late; equal to `spacing`: none [m]
  double max_error = 0.05;    // of a node as decoded [m]
  double update_error = 0.075;  // a node that differs by more from the ship's copy is sent again [m]
  double min_coverage = 0.05;   // nodes of lower coverage are not sent
  double settle_s = 2;          // a block waits this long after its last change, to be complete
  double max_wait_s = 10;       // but no longer than this after its first change
  double deadline_s = 60;       // blocks lost less than this ago are sent before new ones
  double coarse_after_s = 120;  // after waiting this long, an area of fine blocks is sent coarse first

  void validate() const;  // throws std::invalid_argument naming the value
};

// A block's place in the pool.
struct BlockRef {
  std::uint32_t square = 0;
  std::uint8_t block = 0;
};

// The blocks that wait for the link, in a fixed pool of squares of 16 x 16 nodes (16 blocks), and the ship's
// state of each: delivered (the frame that carried it was acknowledged), in flight (sent) or lost. A block
// that became empty is sent as such while the ship may show its earlier content. The order of sending:
//   1 lost blocks while younger than the deadline; after it they count as new;
//   2 coarse blocks of areas whose fine blocks have waited too long;
//   3 blocks of which the ship has nothing, or fewer nodes;
//   4 blocks that changed beyond the update bound (SLAM moved them);
//   5 requested detail;
//   6 fine blocks where the ship has coarse ones;
//   7 unacknowledged blocks again, as the loss requires, in spare capacity of the link;
// in each the newest first, in the last the oldest. When the pool is full, a square is evicted: one with
// nothing to send if there is any, otherwise the one offered longest ago. Evicted blocks are counted, and
// what the ship may show of them is remembered. Deterministic; ties are broken by slot. Only the constructor
// allocates.
class BlockQueue {
 public:
  explicit BlockQueue(const BlockQueueConfig& config);

  // Takes a square's latest content, at any spacing that has a code; counts it as refused otherwise. With
  // `max_error` [m] below the configured one, or a spacing other than the two configured, it is requested
  // detail.
  void offer(const HeightTile& tile, double max_error, std::int64_t now_ns);

  static constexpr std::size_t kMaxBatch = 128;
  // Blocks to send together: the most urgent first, then others near it, so that any prefix is compact.
  struct Batch {
    std::size_t size = 0;
    double max_error = 0;  // [m]
    bool repeats = false;  // the first block has been sent whole and is unacknowledged
    std::array<MapBlock, kMaxBatch> blocks;
    std::array<BlockRef, kMaxBatch> refs;
  };
  // Sets how often a block is sent while unacknowledged: `sendings` times in all (1: no repeats), at least
  // `after_s` apart.
  void repeat(int sendings, double after_s);
  // Fills `batch`, with at most `limit` blocks; false if nothing is worth sending now.
  bool gather(std::int64_t now_ns, std::size_t limit, Batch& batch);
  // The first `count` blocks of the batch are sent now with frame `version`; the ship will have them as
  // `decoded`. A block of which nodes were left out, to fit into a frame, waits for newer content.
  void sent(const Batch& batch, std::size_t count, std::span<const MapBlock> decoded, Version version);
  // The batch's first block cannot be encoded; it waits for newer content. A repeat whose
  // content has changed slightly is sent as it was before, or not repeated.
  void unsendable(const Batch& batch);

  // A square of which the ship has all of the present content.
  struct Whole {
    SpacingCode spacing = 0;
    std::int32_t north = 0, east = 0;  // in squares of 16 nodes
  };
  // The outcome of a block that frame `version` carried; ignored if newer content of it was sent since.
  // `delivered` returns the square when the ship then has all of it.
  std::optional<Whole> delivered(const BlockRef& ref, Version version);
  void lost(const BlockRef& ref, Version version);
  // Whether the ship has a frame, where that is known. settle() sends again the acknowledged blocks that the
  // ship no longer has, and the unacknowledged ones sent before frame `oldest`.
  using Holds = std::function<std::optional<bool>(Version)>;
  void settle(const Holds& holds, Version oldest);
  // After loading a saved state: frames that left since it was saved are unknown, so the ship may show any
  // content of blocks that wait.
  void noteUnknownFrames();
  // Counts the unacknowledged blocks that were sent longest ago as lost; false if there are none.
  bool expireOldest();

  struct Counters {
    std::uint64_t offered = 0;     // blocks that became wanted
    std::uint64_t sent = 0;        // blocks, every sending
    std::uint64_t resent = 0;      // of these, after a loss
    std::uint64_t repeated = 0;    // of these, while unacknowledged
    std::uint64_t updated = 0;     // of these, because the content changed
    std::uint64_t evicted = 0;     // blocks evicted unsent
    std::uint64_t unsendable = 0;  // blocks outside the codec's bounds
    std::uint64_t refused = 0;     // tiles whose spacing has no code
    std::uint64_t missed = 0;      // blocks that the ship had and has lost
    std::uint64_t forgotten = 0;   // evicted squares for which there was no room to remember them
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  struct Census {
    int squares = 0;
    int waiting = 0;    // blocks to be sent, settled or not
    int in_flight = 0;  // blocks sent and unacknowledged
    int in_repeat = 0;  // of these, sent less often than `sendings`
  };
  [[nodiscard]] Census census(int sendings = 1) const;
  // Whether a square fits without evicting one that has something to send.
  [[nodiscard]] bool hasRoom() const;
  // Whether a block of a rectangle [m in nav] at this spacing waits or is unacknowledged.
  [[nodiscard]] bool hasPending(double north_min, double north_max, double east_min, double east_max,
                                double spacing) const;
  // Called for every evicted square that the ship lacks (a block was not sent, or is lost) or of which, with
  // `unacknowledged_only`, blocks were sent and not acknowledged.
  using OnEvicted = std::function<void(const Whole&, bool unacknowledged_only)>;
  void onEvicted(OnEvicted on_evicted) { on_evicted_ = std::move(on_evicted); }
  // Visits every block that the ship has acknowledged: its place, the first and last frames that may have
  // carried it, and the nodes that the ship shows there.
  void eachHeld(const std::function<void(const BlockKey&, Version, Version, const MapBlock&)>& visit) const;
  // Whether a batch other than repeats could be gathered now.
  [[nodiscard]] bool ready(std::int64_t now_ns) const;
  [[nodiscard]] std::size_t memoryBytes() const;
  [[nodiscard]] std::size_t capacity() const { return squares_.size(); }  // squares

  // In link_scheduler_state.cpp, bit by bit.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  enum class State : std::uint8_t { kNever, kInFlight, kDelivered, kLost };
  struct Block {
    MapBlock content;
    std::array<float, MapBlock::kNodes> held{};  // depths that the ship has or will have [m]
    std::uint16_t held_seen = 0;
    float held_error = 0;  // error bound that it was sent with [m]
    State state = State::kNever;
    bool wanted = false;          // something to send, settled or not
    bool blocked = false;         // not encodable, or sent in part: waits for newer content
    bool orphan = false;          // coarse block over fine ones that were evicted
    bool moved = false;           // the content differs from what was sent, within its bounds
    float spread = 0;             // largest difference between this content's decoded versions [m]
    Version first = 0, last = 0;  // frames that carried this content; 0: never sent
    Version has = 0;              // of these, one that arrived
    std::uint8_t flying = 0;      // sendings of this content that are unacknowledged
    std::uint8_t sendings = 0;    // of this content since the last outcome
    std::int64_t sent_ns = 0;
    std::int64_t changed_ns = 0;  // content changed last
    std::int64_t since_ns = 0;    // became wanted
  };
  struct Square {
    bool used = false;
    SpacingCode spacing = 0;
    std::int32_t north = 0, east = 0;
    double max_error = 0;
    std::uint64_t order = 0;  // of the last offer
    std::array<Block, 16> blocks{};
  };
  // Evicted squares of which the ship may show something: the frames that carried their blocks (0: nothing),
  // and which of them were acknowledged.
  struct Remembered {
    SpacingCode spacing = 0;
    std::int32_t north = 0, east = 0;
    std::uint16_t has = 0;  // bit by block
    std::array<Version, 16> version{};
    // By place.
    friend bool operator<(const Remembered& a, const Remembered& b) {
      return std::tie(a.spacing, a.north, a.east) < std::tie(b.spacing, b.north, b.east);
    }
  };
  enum class Urgency { kRetry, kNewCoarse, kNew, kChanged, kRequested, kRefine, kRepeat, kNone };
  struct Best {
    Urgency urgency = Urgency::kNone;
    std::size_t square = 0, block = 0;
  };

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  template <typename Archive, typename Self>
  static void exchangeBlock(Archive& archive, Self& block);
  [[nodiscard]] bool isValid(const Square& square) const;
  std::size_t slotFor(SpacingCode spacing, std::int32_t north, std::int32_t east);
  void evict(std::size_t slot);
  [[nodiscard]] bool differs(const Square& square, const Block& block) const;
  void judge(const Square& square, Block& block, std::int64_t now_ns);
  [[nodiscard]] Urgency urgency(const Square& square, const Block& block, std::int64_t now_ns) const;
  [[nodiscard]] bool settled(const Block& block, std::int64_t now_ns) const;
  [[nodiscard]] bool fineIsLate(const Block& coarse, std::int64_t now_ns) const;
  [[nodiscard]] bool coarseIsHeld(const Block& fine) const;
  [[nodiscard]] Best mostUrgent(std::int64_t now_ns) const;
  void makeLost(Block& block);
  static void markUnknown(Block& block);
  void remember(const Square& square);
  void recall(Square& square);
  void settle(Remembered& square, const Holds& holds, Version oldest);
  [[nodiscard]] Block& at(const BlockRef& ref) { return squares_[ref.square].blocks[ref.block]; }
  template <class Visit>
  void eachCandidate(const Square& seed, std::int64_t now_ns, Visit visit) const;

  BlockQueueConfig config_;
  SpacingCode fine_, coarse_;
  int ratio_;  // coarse spacing over fine
  std::vector<Square> squares_;
  SquareIndex index_;
  static constexpr std::size_t kRememberedASquare = 4;  // per square of the pool
  std::vector<Remembered> remembered_;                  // sorted by place
  OnEvicted on_evicted_;
  std::uint64_t order_ = 0;
  Version oldest_ = 0;  // of the last settle()
  int sendings_ = 1;
  std::int64_t repeat_after_ns_ = 0;
  std::int64_t now_ns_ = 0;
  Counters counters_;
};

}  // namespace fathom::telemetry
