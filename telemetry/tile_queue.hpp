#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/height_tile.hpp"

namespace fathom::telemetry {

// The tiles that wait for the link, in a fixed pool, and the order in which they are worth sending.
// Deterministic: ties go by key.
class TileQueue {
 public:
  struct Config {
    int max_tiles;
    int coarse_stride, fine_stride;
    double update_depth;  // [m]
    double settle_s;
    double loss_rate, delivery_goal;
  };
  explicit TileQueue(const Config& config);

  void offer(const HeightTile& tile, std::int64_t now_ns);

  struct Choice {
    int slot = -1;  // none when negative
    int stride = 0;
  };
  // The tile most worth sending now.
  [[nodiscard]] Choice choose(std::int64_t now_ns) const;
  [[nodiscard]] const HeightTile& tile(int slot) const { return tiles_[static_cast<std::size_t>(slot)]; }
  // The choice goes out in so many fragments.
  void sent(const Choice& choice, int fragments);
  // The choice cannot be encoded; it waits for newer content.
  void unsendable(const Choice& choice);

  struct Counters {
    std::uint64_t offered = 0, evicted = 0, unsendable = 0;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] int held() const;
  [[nodiscard]] int waiting() const;  // held and not yet delivered with the goal's probability
  [[nodiscard]] std::size_t memoryBytes() const;

 private:
  // What is known of a tile besides its content; small, because every choice looks at all of them.
  struct Entry {
    bool used = false;
    bool blocked = false;  // cannot be encoded
    std::int32_t north_index = 0, east_index = 0;
    std::int16_t level = 0;
    std::uint32_t revision = 0;
    std::uint64_t order = 0;      // of the last offer that brought new content
    std::int64_t offered_ns = 0;  // its time
    int seen_nodes = 0;
    int changed_nodes = 0;  // newly seen or moved since the content sent last
    int stride = 0;         // sent last, 0: never sent
    int sends = 0;          // of the present content at that stride
    int fragments = 1;      // at that stride
  };
  // Lower is more urgent; the order of LinkScheduler's comment.
  enum class Urgency { kNew, kChanged, kRepeatCoarse, kRefine, kRepeatFine, kUnsettled, kNone };
  [[nodiscard]] Urgency urgency(const Entry& entry, std::int64_t now_ns) const;
  [[nodiscard]] bool moreUrgent(const Entry& a, Urgency ua, const Entry& b, Urgency ub) const;
  [[nodiscard]] bool repeatsDone(const Entry& entry) const;
  [[nodiscard]] std::size_t slotFor(const HeightTile& tile);

  Config config_;
  std::vector<Entry> entries_;
  std::vector<HeightTile> tiles_;  // content of the entry of the same index
  std::uint64_t order_ = 0;
  Counters counters_;
};

}  // namespace fathom::telemetry
