#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <tuple>
#include <vector>

#include "realtime/kernel/state_archive_fwd.hpp"
#include "recon/geometry/height_tile.hpp"
#include "telemetry/map/map_block.hpp"
#include "telemetry/vehicle/square_index.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

struct BlockQueueConfig {
  int max_squares = 1024;       // pool
  double spacing = 0.25;        // of the lattice that every area gets [m]
  double coarse_spacing = 1;    // of the first sight where the other does not follow; equal: none [m]
  double max_error = 0.05;      // of a node as decoded [m]
  double update_error = 0.075;  // a node further than this from what the other side holds is sent again [m]
  double min_coverage = 0.05;   // nodes seen less than this are not sent
  double settle_s = 2;          // a block still growing waits this long after its last change
  double max_wait_s = 10;       // but no longer than this since it was first wanted
  double deadline_s = 60;       // what was lost is sent again before new blocks until it is so old
  double coarse_after_s = 120;  // an area whose fine blocks have waited so long goes coarse first

  void validate() const;  // throws std::invalid_argument naming the value
};

// A block's place in the pool.
struct BlockRef {
  std::uint32_t square = 0;
  std::uint8_t block = 0;
};

// The pieces of map that wait for the link, in a fixed pool of squares of 16 x 16 nodes (16 blocks), with
// what the other side holds of each: has (there was word of the frame that carried it), may have (sent) or
// cannot have. A block that was emptied is sent like any other, while the other side may show it. The order
// in which they are worth sending:
//   1 blocks that were lost, while younger than the deadline, and from then on as if they were new;
//   2 coarse blocks of areas whose fine blocks have waited too long;
//   3 blocks that the other side has nothing of, or less than now;
//   4 blocks that changed beyond the update bound (SLAM moved them);
//   5 requested detail;
//   6 fine blocks where the other side has coarse ones;
//   7 blocks without word, as often as the loss asks for: what is left of a frame and of the time;
// in each the newest first, in the last the oldest. When the pool is full the square needed least gives way:
// one with nothing to send, else the one offered longest ago; lost blocks are counted, and what the other
// side may show of it is remembered. Deterministic; ties go by slot. Only the construction allocates.
class BlockQueue {
 public:
  explicit BlockQueue(const BlockQueueConfig& config);

  // A square's latest content, at any spacing that has a code; ignored and counted otherwise. `max_error` [m]
  // below the configured one, or a spacing other than the two configured: requested detail.
  void offer(const HeightTile& tile, double max_error, std::int64_t now_ns);

  static constexpr std::size_t kMaxBatch = 128;
  // Blocks to send together: the most urgent first, then others near it, so that any prefix is compact.
  struct Batch {
    std::size_t size = 0;
    double max_error = 0;  // [m]
    bool repeats = false;  // the first block has been sent whole, and there is no word
    std::array<MapBlock, kMaxBatch> blocks;
    std::array<BlockRef, kMaxBatch> refs;
  };
  // Blocks without word are sent up to `sendings` times in all, no sooner than `after_s` one after the other;
  // 1: once.
  void repeat(int sendings, double after_s);
  // Fills `batch`, with at most `limit` blocks; false if nothing is worth sending now.
  bool gather(std::int64_t now_ns, std::size_t limit, Batch& batch);
  // The first `count` blocks of the batch go out now, with frame `version`, and will be held as `decoded`.
  // One that lacks nodes there, because no frame is long enough, waits for newer content.
  void sent(const Batch& batch, std::size_t count, std::span<const MapBlock> decoded, Version version);
  // The batch's first block cannot be encoded; it waits for newer content. A repeat that has moved a little
  // since it was sent goes as it was sent, else it is not repeated.
  void unsendable(const Batch& batch);

  // A square that the other side holds whole, as it is now.
  struct Whole {
    SpacingCode spacing = 0;
    std::int32_t north = 0, east = 0;  // in squares of 16 nodes
  };
  // What became of a block that frame `version` carried. Nothing happens if other content of it was sent
  // since. `delivered` gives the square if that was the last that it lacked.
  std::optional<Whole> delivered(const BlockRef& ref, Version version);
  void lost(const BlockRef& ref, Version version);
  // What there is to say of all frames of the past: whether the other side holds one, where that is known. A
  // block that it had and holds no more goes again; so does one without word that was sent before `oldest`.
  using Holds = std::function<std::optional<bool>(Version)>;
  void settle(const Holds& holds, Version oldest);
  // Frames may have left of which nothing is known: the other side may show what was never sent.
  void noteUnknownFrames();
  // The blocks without word that were sent longest ago go again, as if they were lost. False: there are none.
  bool doubt();

  struct Counters {
    std::uint64_t offered = 0;     // blocks that brought something to send
    std::uint64_t sent = 0;        // blocks, every sending
    std::uint64_t resent = 0;      // of these, because the one before was lost
    std::uint64_t repeated = 0;    // of these, before there was word
    std::uint64_t updated = 0;     // of these, because the content changed
    std::uint64_t evicted = 0;     // blocks that gave way unsent
    std::uint64_t unsendable = 0;  // blocks outside the codec's bounds
    std::uint64_t refused = 0;     // tiles whose spacing has no code
    std::uint64_t missed = 0;      // blocks that the other side had and holds no more
    std::uint64_t forgotten = 0;   // squares that it may show and that were not remembered
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  struct Census {
    int squares = 0;
    int waiting = 0;    // blocks to be sent, settled or not
    int in_flight = 0;  // blocks sent and without word
    int unsure = 0;     // of these, sent less often than asked
  };
  [[nodiscard]] Census census(int sendings = 1) const;
  // Whether a square can be taken in without another giving way that has something to send.
  [[nodiscard]] bool hasRoom() const;
  // Whether something of a rectangle [m in nav] at this spacing is to be sent, or was and there is no word.
  [[nodiscard]] bool owes(double north_min, double north_max, double east_min, double east_max,
                          double spacing) const;
  // Called for every square that is not in the pool any more and that the other side lacks (something of it
  // was not sent, or is held no more) or, with `spare`, of which there is no word.
  using GaveWay = std::function<void(const Whole&, bool spare)>;
  void onGaveWay(GaveWay gave_way) { gave_way_ = std::move(gave_way); }
  // Every block that the other side has, by word: its place, the frames that may have carried it (first and
  // last), and the nodes that it shows there.
  void eachHeld(const std::function<void(const BlockKey&, Version, Version, const MapBlock&)>& visit) const;
  // Whether a batch could be gathered now, repeats apart.
  [[nodiscard]] bool ready(std::int64_t now_ns) const;
  [[nodiscard]] std::size_t memoryBytes() const;
  [[nodiscard]] std::size_t capacity() const { return squares_.size(); }  // squares

  // In link_state.cpp, bit by bit.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  enum class State : std::uint8_t { kNever, kInFlight, kDelivered, kLost };
  struct Block {
    MapBlock content;
    std::array<float, MapBlock::kNodes> held{};  // depths that the other side has or will have [m]
    std::uint16_t held_seen = 0;
    float held_error = 0;  // that it was sent with [m]
    State state = State::kNever;
    bool wanted = false;          // something to send, settled or not
    bool blocked = false;         // cannot be encoded, or not whole
    bool orphan = false;          // coarse, and the fine one gave way
    bool moved = false;           // the content is not quite what was sent
    float spread = 0;             // of what the sendings of this content are decoded as [m]
    Version first = 0, last = 0;  // frames that carried this content; 0: never sent
    Version has = 0;              // of these, one that arrived
    std::uint8_t flying = 0;      // sendings of this content without word
    std::uint8_t sendings = 0;    // of this content since there was word
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
  // Squares that gave way and of which the other side may show something: the frames that carried their
  // blocks (0: nothing), and of which there was word.
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
  [[nodiscard]] bool canStand(const Square& square) const;
  std::size_t slotFor(SpacingCode spacing, std::int32_t north, std::int32_t east);
  void giveWay(std::size_t slot);
  [[nodiscard]] bool differs(const Square& square, const Block& block) const;
  void judge(const Square& square, Block& block, std::int64_t now_ns);
  [[nodiscard]] Urgency urgency(const Square& square, const Block& block, std::int64_t now_ns) const;
  [[nodiscard]] bool settled(const Block& block, std::int64_t now_ns) const;
  [[nodiscard]] bool fineIsLate(const Block& coarse, std::int64_t now_ns) const;
  [[nodiscard]] bool coarseIsHeld(const Block& fine) const;
  [[nodiscard]] Best mostUrgent(std::int64_t now_ns) const;
  void makeLost(Block& block);
  static void mayShowAnything(Block& block);
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
  static constexpr std::size_t kRememberedASquare = 4;  // of the pool
  std::vector<Remembered> remembered_;                  // sorted by place
  GaveWay gave_way_;
  std::uint64_t order_ = 0;
  Version oldest_ = 0;  // as settle() was told last
  int sendings_ = 1;
  std::int64_t repeat_after_ns_ = 0;
  std::int64_t now_ns_ = 0;
  Counters counters_;
};

}  // namespace fathom::telemetry
