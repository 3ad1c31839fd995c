#include "telemetry/tile_queue.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "telemetry/link_scheduler.hpp"

namespace fathom::telemetry {
namespace {

int seenNodes(const HeightTile& tile) {
  return static_cast<int>(std::count_if(tile.nodes.begin(), tile.nodes.end(),
                                        [](const HeightTile::Node& n) { return n.coverage > 0; }));
}

int changedNodes(const HeightTile& before, const HeightTile& now, double update_depth) {
  int changed = 0;
  for (std::size_t i = 0; i < now.nodes.size(); ++i) {
    const bool was = before.nodes[i].coverage > 0, is = now.nodes[i].coverage > 0;
    changed +=
        was != is || (is && std::abs(now.nodes[i].depth - before.nodes[i].depth) >= update_depth) ? 1 : 0;
  }
  return changed;
}

}  // namespace

TileQueue::TileQueue(const Config& config)
    : config_(config),
      entries_(static_cast<std::size_t>(config.max_tiles)),
      tiles_(static_cast<std::size_t>(config.max_tiles)) {}

std::size_t TileQueue::slotFor(const HeightTile& tile) {
  std::size_t best = 0;
  // Free, then delivered longest ago, then offered longest ago.
  const auto rank = [&](const Entry& e) {
    const int kind = !e.used ? 0 : urgency(e, e.offered_ns) == Urgency::kNone ? 1 : 2;
    return std::tuple(kind, e.order);
  };
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Entry& e = entries_[i];
    if (e.used && e.north_index == tile.north_index && e.east_index == tile.east_index &&
        e.level == tile.level)
      return i;
    if (rank(e) < rank(entries_[best])) best = i;
  }
  Entry& given = entries_[best];
  if (given.used && urgency(given, given.offered_ns) != Urgency::kNone) ++counters_.evicted;
  given = Entry{};
  return best;
}

void TileQueue::offer(const HeightTile& tile, std::int64_t now_ns) {
  const int seen = seenNodes(tile);
  if (seen == 0) return;
  const std::size_t slot = slotFor(tile);
  Entry& e = entries_[slot];
  if (e.used) {
    if (tile.revision <= e.revision) return;
    // What was sent stays as it is until enough has changed, so that fragments of its repeats fit together.
    const int changed = changedNodes(tiles_[slot], tile, config_.update_depth);
    if (e.stride != 0 && changed == 0) return;
    if (e.stride != 0) e.changed_nodes = std::min(e.changed_nodes + changed, HeightTile::kNodes);
  }
  e.used = true;
  e.blocked = false;
  e.north_index = tile.north_index;
  e.east_index = tile.east_index;
  e.level = tile.level;
  e.revision = tile.revision;
  e.order = ++order_;
  e.offered_ns = now_ns;
  e.seen_nodes = seen;
  tiles_[slot] = tile;
  ++counters_.offered;
}

bool TileQueue::repeatsDone(const Entry& e) const {
  return e.sends >= repeatsForGoal(config_.loss_rate, config_.delivery_goal, e.fragments);
}

TileQueue::Urgency TileQueue::urgency(const Entry& e, std::int64_t now_ns) const {
  if (!e.used || e.blocked) return Urgency::kNone;
  // A tile in view grows with every pair; sent now it would have to be sent again at once.
  const bool settled = static_cast<double>(now_ns - e.offered_ns) >= config_.settle_s * 1e9;
  if (e.stride == 0) return settled ? Urgency::kNew : Urgency::kUnsettled;
  if (e.changed_nodes > 0) return settled ? Urgency::kChanged : Urgency::kUnsettled;
  const bool coarse = e.stride > config_.fine_stride;
  if (!repeatsDone(e)) return coarse ? Urgency::kRepeatCoarse : Urgency::kRepeatFine;
  return coarse ? Urgency::kRefine : Urgency::kNone;
}

bool TileQueue::moreUrgent(const Entry& a, Urgency ua, const Entry& b, Urgency ub) const {
  if (ua != ub) return ua < ub;
  const auto key = [](const Entry& e) { return std::tuple(e.level, e.north_index, e.east_index); };
  switch (ua) {
    case Urgency::kChanged:
      return std::tuple(-a.changed_nodes, key(a)) < std::tuple(-b.changed_nodes, key(b));
    case Urgency::kRepeatCoarse:
    case Urgency::kRepeatFine:  // the fewest sends first, so that all tiles gain evenly
      return std::tuple(a.sends, b.order, key(a)) < std::tuple(b.sends, a.order, key(b));
    case Urgency::kUnsettled:
      return std::tuple(-a.seen_nodes, key(a)) < std::tuple(-b.seen_nodes, key(b));
    default:  // newest first
      return std::tuple(b.order, key(a)) < std::tuple(a.order, key(b));
  }
}

TileQueue::Choice TileQueue::choose(std::int64_t now_ns) const {
  Choice choice;
  Urgency best = Urgency::kNone;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Urgency u = urgency(entries_[i], now_ns);
    if (u == Urgency::kNone) continue;
    if (choice.slot >= 0 &&
        !moreUrgent(entries_[i], u, entries_[static_cast<std::size_t>(choice.slot)], best))
      continue;
    choice.slot = static_cast<int>(i);
    best = u;
  }
  if (choice.slot < 0) return choice;
  const Entry& e = entries_[static_cast<std::size_t>(choice.slot)];
  choice.stride = e.stride == 0              ? config_.coarse_stride
                  : best == Urgency::kRefine ? config_.fine_stride
                                             : e.stride;
  return choice;
}

void TileQueue::sent(const Choice& choice, int fragments) {
  Entry& e = entries_[static_cast<std::size_t>(choice.slot)];
  e.sends = e.stride == choice.stride && e.changed_nodes == 0 ? e.sends + 1 : 1;
  e.stride = choice.stride;
  e.changed_nodes = 0;
  e.fragments = fragments;
}

void TileQueue::unsendable(const Choice& choice) {
  entries_[static_cast<std::size_t>(choice.slot)].blocked = true;
  ++counters_.unsendable;
}

int TileQueue::held() const {
  return static_cast<int>(
      std::count_if(entries_.begin(), entries_.end(), [](const Entry& e) { return e.used; }));
}

int TileQueue::waiting() const {
  return static_cast<int>(std::count_if(entries_.begin(), entries_.end(), [&](const Entry& e) {
    return urgency(e, e.offered_ns) != Urgency::kNone;
  }));
}

std::size_t TileQueue::memoryBytes() const {
  return entries_.size() * sizeof(Entry) + tiles_.size() * sizeof(HeightTile);
}

}  // namespace fathom::telemetry
