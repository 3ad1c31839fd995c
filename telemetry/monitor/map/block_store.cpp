#include "telemetry/monitor/map/block_store.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::monitor {

using telemetry::BlockKey;
using telemetry::MapBlock;

namespace {

constexpr int kBlockShift = 2;  // a block is four nodes wide

int chunkShift(const BlockKey& key) {
  return kChunkCode - kBlockShift - key.spacing;
}

bool showable(const MapBlock& block) {
  if (block.key.spacing > kCoarsestCode) return false;
  const double size = MapBlock::kSide * telemetry::spacingOf(block.key.spacing);
  if (std::abs(block.key.north * size) > kMaxHorizontal_m ||
      std::abs(block.key.east * size) > kMaxHorizontal_m)
    return false;
  if (!(block.sigma >= 0 && std::isfinite(block.sigma))) return false;
  for (int n = 0; n < MapBlock::kNodes; ++n)
    if (block.isSeen(n) && !(block.depth[static_cast<std::size_t>(n)] >= kMinDepth_m &&
                             block.depth[static_cast<std::size_t>(n)] <= kMaxDepth_m))
      return false;
  return true;
}

// Whether two contents of one block differ by more than both error bounds and 5 cm. More seen nodes are no
// change.
bool differs(const StoredBlock& old, const MapBlock& block, double max_error) {
  constexpr double kLeastChange_m = 0.05;
  const double bound = std::max(old.max_error + max_error, kLeastChange_m);
  for (int n = 0; n < MapBlock::kNodes; ++n) {
    const auto i = static_cast<std::size_t>(n);
    if (block.isSeen(n) && old.block.isSeen(n) &&
        std::abs(double{old.block.depth[i]} - block.depth[i]) > bound)
      return true;
  }
  return false;
}

}  // namespace

ChunkKey BlockStore::chunkOf(const BlockKey& key) {
  return {key.north >> chunkShift(key), key.east >> chunkShift(key)};
}

std::uint32_t BlockStore::chunkSlot(const BlockKey& key) {
  const auto mask = (std::uint32_t{1} << chunkShift(key)) - 1;
  return (static_cast<std::uint32_t>(key.north) & mask) << kCoarsestCode |
         (static_cast<std::uint32_t>(key.east) & mask);
}

const BlockStore::Chunk* BlockStore::chunk(ChunkKey key) const {
  const auto found = chunks_.find(key);
  return found == chunks_.end() ? nullptr : found->second.get();
}

BlockStore::Chunk& BlockStore::own(std::shared_ptr<const Chunk>& held) {
  if (held == nullptr) held = std::make_shared<Chunk>();
  if (held.use_count() > 1) held = std::make_shared<Chunk>(*held);
  return const_cast<Chunk&>(*held);  // created above or in an earlier call, and never constant
}

const StoredBlock* BlockStore::find(const BlockKey& key) const {
  if (key.spacing > kCoarsestCode) return nullptr;
  const Chunk* in = chunk(chunkOf(key));
  if (in == nullptr) return nullptr;
  const auto& level = in->levels[key.spacing];
  const auto found = level.find(chunkSlot(key));
  return found == level.end() ? nullptr : &found->second;
}

bool BlockStore::isStale(const BlockKey& key, telemetry::Version version) const {
  if (const StoredBlock* held = find(key)) return version < held->version;
  const auto gone = withdrawn_.find(key);
  return gone != withdrawn_.end() && version < gone->second;
}

void BlockStore::noteWithdrawn(const BlockKey& key, telemetry::Version version) {
  withdrawn_[key] = version;
  if (withdrawn_.size() <= kMaxWithdrawn) return;
  const auto oldest = std::min_element(withdrawn_.begin(), withdrawn_.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
  withdrawn_.erase(oldest);
}

bool BlockStore::put(const MapBlock& block, const Origin& origin) {
  if (!showable(block)) {
    ++counters_.refused;
    return false;
  }
  ++counters_.taken;
  if (isStale(block.key, origin.version)) {
    ++counters_.stale;
    return true;
  }
  if (block.seen == 0) {
    noteWithdrawn(block.key, origin.version);
    if (find(block.key) == nullptr) return true;
    ++counters_.withdrawn;
    std::erase(arrivals_[block.key.spacing], block.key);
    remove(block.key);
    return true;
  }
  withdrawn_.erase(block.key);
  auto& level = own(chunks_[chunkOf(block.key)]).levels[block.key.spacing];
  const auto [at, is_new] = level.try_emplace(chunkSlot(block.key));
  StoredBlock& stored = at->second;
  if (is_new) {
    ++size_;
    ++counts_[block.key.spacing];
    arrivals_[block.key.spacing].push_back(block.key);
  } else {
    ++counters_.replaced;
    if (differs(stored, block, origin.max_error)) {
      ++counters_.changed;
      stored.changed_utc_ns = origin.utc_ns;
    }
  }
  // A block sent again without colour keeps the colour that it had.
  const bool keep_colour = !is_new && stored.has_colour && !origin.has_colour;
  const auto colour = keep_colour ? stored.block.colour : block.colour;
  stored.block = block;
  stored.block.colour = colour;
  stored.has_colour = origin.has_colour || keep_colour;
  stored.max_error = static_cast<float>(origin.max_error);
  stored.version = origin.version;
  stored.received_utc_ns = origin.utc_ns;
  touch(block.key);
  if (size_ > max_blocks_) evict();
  return true;
}

void BlockStore::forgetBefore(telemetry::Version version) {
  for (auto& arrivals : arrivals_)
    std::erase_if(arrivals, [&](const BlockKey& key) {
      if (find(key)->version >= version) return false;
      remove(key);
      return true;
    });
  std::erase_if(withdrawn_, [&](const auto& gone) { return gone.second < version; });
}

void BlockStore::touch(const BlockKey& key) {
  ++version_;
  int coarsest = key.spacing;
  for (int code = kCoarsestCode; code > coarsest; --code)
    if (counts_[static_cast<std::size_t>(code)] > 0) coarsest = code;
  // A neighbour's mesh looks at most one cell of the coarsest spacing across the border.
  const ChunkKey home = chunkOf(key);
  const Unit size = Unit{MapBlock::kSide} << key.spacing, margin = Unit{1} << coarsest;
  const Unit north = static_cast<Unit>(key.north * size - home.north * kChunkUnits);
  const Unit east = static_cast<Unit>(key.east * size - home.east * kChunkUnits);
  for (std::int32_t dn = -1; dn <= 1; ++dn) {
    for (std::int32_t de = -1; de <= 1; ++de) {
      if ((dn < 0 && north > margin) || (dn > 0 && north + size + margin < kChunkUnits)) continue;
      if ((de < 0 && east > margin) || (de > 0 && east + size + margin < kChunkUnits)) continue;
      const auto found = chunks_.find({home.north + dn, home.east + de});
      if (found != chunks_.end()) own(found->second).version = version_;
    }
  }
}

void BlockStore::remove(const BlockKey& key) {
  const auto in = chunks_.find(chunkOf(key));
  Chunk& chunk = own(in->second);
  chunk.levels[key.spacing].erase(chunkSlot(key));
  --size_;
  --counts_[key.spacing];
  touch(key);
  const bool empty =
      std::all_of(chunk.levels.begin(), chunk.levels.end(), [](const auto& level) { return level.empty(); });
  if (!empty) return;
  chunks_.erase(in);
  ++generation_;
}

void BlockStore::evict() {
  for (auto& arrivals : arrivals_) {
    if (arrivals.empty()) continue;
    const BlockKey key = arrivals.front();
    arrivals.pop_front();
    ++counters_.evicted;
    remove(key);
    return;
  }
}

}  // namespace fathom::monitor
