#include "recon/fusion/cell_reading.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::fusion {
namespace {

// Horizontal error of poses and points, in spacings: on a slope of 45 degrees it changes the height equally.
constexpr double kSidewaysError = 0.5;
// The same between levels: a coarser cell's mean is of ground up to a spacing away, on steep slopes too.
constexpr double kSidewaysErrorOfLevels = 1.0;
// A second surface with fewer observations than the best one's over this is an outlier, not a layer.
constexpr std::uint32_t kLayerShare = 3;

// Sums of neighbouring layers, heights in units below `base`.
struct Surface {
  double weight = 0, height = 0, squares = 0;
  std::array<double, 3> colour{};
  std::uint32_t count = 0;
  std::int32_t first_bin = 0, last_bin = 0;

  void add(const Layer& layer, int shift, std::int64_t base) {
    const auto lower = static_cast<double>((std::int64_t{layer.bin} << shift) - base);
    const auto w = static_cast<double>(layer.sums.weight()), h = static_cast<double>(layer.sums.height());
    weight += w;
    height += h + lower * w;
    squares += static_cast<double>(layer.sums.squares()) + 2 * lower * h + lower * lower * w;
    for (int c = 0; c < 3; ++c)
      colour[static_cast<std::size_t>(c)] += static_cast<double>(layer.sums.colour(c));
    if (count == 0) first_bin = layer.bin;
    count += layer.sums.count();
    last_bin = layer.bin;
  }
  [[nodiscard]] double mean() const { return height / weight; }
  // Mean squared deviation [units^2].
  [[nodiscard]] double spread() const { return std::max(0.0, squares / weight - mean() * mean()); }
};

// Least relief that counts, in spacings: of flat areas the finest is coarsened first.
constexpr double kFlat = 0.05;
// Factor of value of an area that the last mesh saw, since the next passes overlap it; it halves after so
// many meshes (2.5 minutes at 2 Hz).
constexpr double kFreshness = 4, kFreshMeshes = 300;
// The same for an area near the vehicle; it halves at this distance [m], a few survey lines.
constexpr double kNearness = 4, kNear = 10;
// Factor of value of an area that the ship does not have yet.
constexpr double kUnsent = 2;
// Groups coarsened before all are compared again.
constexpr std::size_t kBatch = 64;
// Tiles checked in each fuse() for a relief to be measured again.
constexpr std::size_t kReliefTiles = 16;
// A cell's layers and list cost memory even in a group that is hardly seen [layers].
constexpr double kGroupCost = 64;

}  // namespace

CellReading readCell(const QuadtreeStore& store, int level, std::int32_t first) {
  CellReading out;
  if (first == QuadtreeStore::kNone) return out;
  const int shift = store.binShiftOf(level);
  const double min_sigma = store.config().min_sigma / kHeightUnit;  // [units]
  // Variance of one observation of weight w is `unit` / w.
  const double unit = min_sigma * min_sigma * kMaxWeight;
  const double sideways = kSidewaysError * store.spacing(level) / kHeightUnit;
  const double gate2 = store.config().gate * store.config().gate;
  const std::int64_t base = std::int64_t{store.layer(first).bin} << shift;

  Surface best, current;
  std::uint32_t second = 0;
  const auto close = [&] {
    if (current.count > best.count) {
      second = std::max(second, best.count);
      best = current;
    } else {
      second = std::max(second, current.count);
    }
  };
  Surface last;  // the last layer alone: neighbours are compared
  for (std::int32_t k = first; k != QuadtreeStore::kNone; k = store.layer(k).next) {
    const Layer& layer = store.layer(k);
    Surface alone;
    alone.add(layer, shift, base);
    if (last.count > 0) {
      const double apart = alone.mean() - last.mean();
      const auto variance = [&](const Surface& s) { return unit * s.count / s.weight + s.spread(); };
      if (apart * apart > gate2 * (variance(alone) + variance(last) + sideways * sideways)) {
        close();
        current = Surface{};
      }
    }
    current.add(layer, shift, base);
    last = alone;
  }
  close();

  out.count = best.count;
  out.layered = second * kLayerShare >= best.count;
  out.depth = (static_cast<double>(base) + best.mean()) * kHeightUnit;
  // Mean squared deviation in sigmas: 1 when the meshes scatter as their sigmas predict.
  const double disagreement = best.spread() * best.weight / unit / best.count;
  out.variance = (1 + disagreement) * unit / best.weight * kHeightUnit * kHeightUnit;
  for (std::size_t c = 0; c < 3; ++c) out.colour[c] = static_cast<float>(best.colour[c] / best.weight);
  out.first_bin = best.first_bin;
  out.last_bin = best.last_bin;
  return out;
}

SurfaceVote vote(const QuadtreeStore& store, const CellReading& finer, const CellReading& coarser,
                 int coarser_level) {
  if (!coarser.seen() || coarser.count * kLayerShare < finer.count) return SurfaceVote::kStands;
  const double sideways = kSidewaysErrorOfLevels * store.spacing(coarser_level);
  const double gate = store.config().gate;
  const double apart = finer.depth - coarser.depth;
  if (apart * apart <= gate * gate * (finer.variance + coarser.variance + sideways * sideways))
    return SurfaceVote::kStands;
  return coarser.count > finer.count ? SurfaceVote::kOutvoted : SurfaceVote::kLayered;
}

bool QuadtreeStore::hasRoom() const {
  return free_tile_ != kNone && free_layer_ != kNone &&
         index_.room() > static_cast<std::size_t>(config_.max_level);
}

float QuadtreeStore::measureRelief(std::int32_t slot) const {
  std::array<double, kCells * kCells> depth;
  for (int cell = 0; cell < kCells * kCells; ++cell) {
    const CellReading r = readCell(*this, tile(slot).key.level, head(slot, cell));
    depth[static_cast<std::size_t>(cell)] = r.seen() ? r.depth : std::nan("");
  }
  double sum = 0;
  int count = 0;
  const auto add = [&](std::size_t k, std::size_t step) {
    const double second = std::abs(depth[k - step] - 2 * depth[k] + depth[k + step]);
    if (!std::isfinite(second)) return;
    sum += second;
    ++count;
  };
  for (std::size_t i = 1; i + 1 < kCells; ++i) {
    for (std::size_t j = 1; j + 1 < kCells; ++j) {
      add(i * kCells + j, kCells);
      add(i * kCells + j, 1);
    }
  }
  return count > 0 ? static_cast<float>(sum / count) : 0.0F;
}

void QuadtreeStore::refreshRelief() {
  for (std::size_t k = 0; k < kReliefTiles; ++k) {
    relief_next_ = relief_next_ + 1 < tiles_.size() ? relief_next_ + 1 : 0;
    Tile& t = tiles_[relief_next_];
    if (!t.used || t.relief_of == t.changed) continue;
    t.relief = measureRelief(static_cast<std::int32_t>(relief_next_));
    t.relief_of = t.changed;
  }
}

QuadtreeStore::Candidate QuadtreeStore::valueOf(const TileKey& parent, std::uint32_t now) const {
  Candidate out;
  out.parent = parent;
  std::uint32_t seen = 0;
  double relief = 0, layers = kGroupCost;
  bool sent = true;
  for (int c = 0; c < 4; ++c) {
    const std::int32_t slot = index_.find(TileIndex::child(parent, c));
    if (slot < 0) continue;
    const Tile& t = tile(slot);
    out.changed = std::max(out.changed, t.changed);
    seen = std::max(seen, t.seen);
    relief = std::max(relief, static_cast<double>(t.relief));
    layers += t.layers;
    sent = sent && t.sent;
  }
  const double size = tileSize(parent.level);
  double value = relief + kFlat * spacing(parent.level + 1);
  value *= 1 + kFreshness / (1 + (now - seen) / kFreshMeshes);
  if (vehicle_.allFinite()) {
    const Eigen::Vector2d middle((parent.north_index + 0.5) * size, (parent.east_index + 0.5) * size);
    const double distances = (middle - vehicle_).norm() / kNear;
    value *= 1 + kNearness / (1 + distances * distances);
  }
  if (!sent) value *= kUnsent;
  out.value = value / layers;
  return out;
}

void QuadtreeStore::findCandidates(std::uint32_t now) {
  candidates_.clear();
  for (const Tile& t : tiles_) {
    if (!t.used || t.key.level == 0) continue;
    // Each group once, at its first child with sums: one look decides for most.
    const TileKey parent = TileIndex::parent(t.key);
    const int own = (t.key.north_index & 1) * 2 + (t.key.east_index & 1);
    bool first = true;
    for (int c = 0; first && c < own; ++c) first = index_.find(TileIndex::child(parent, c)) < 0;
    if (first && canCoarsen(parent)) candidates_.push_back(valueOf(parent, now));
  }
  std::sort(candidates_.begin(), candidates_.end(), [](const Candidate& a, const Candidate& b) {
    return a.value != b.value ? a.value > b.value : TileIndex::pack(a.parent) > TileIndex::pack(b.parent);
  });
  candidates_left_ = std::min(kBatch, candidates_.size());
}

bool QuadtreeStore::makeRoom(std::uint32_t now) {
  while (!hasRoom()) {
    if (candidates_left_ == 0) {
      findCandidates(now);
      if (candidates_.empty()) return false;
    }
    const Candidate next = candidates_.back();
    candidates_.pop_back();
    --candidates_left_;
    // Unless it has changed since all were compared.
    if (canCoarsen(next.parent) && valueOf(next.parent, now).changed == next.changed)
      coarsen(next.parent, now);
  }
  return true;
}

void QuadtreeStore::noteSent(const TileKey& key) {
  const std::int32_t found = index_.find(key);
  if (found == TileIndex::kAbsent) return;
  if (found >= 0) at(found).sent = true;
  if (index_.below(key) > 0)
    for (int c = 0; c < 4; ++c) noteSent(TileIndex::child(key, c));
}

}  // namespace fathom::fusion
