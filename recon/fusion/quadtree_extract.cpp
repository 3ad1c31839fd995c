#include <algorithm>
#include <cmath>

#include "recon/fusion/cell_reading.hpp"
#include "recon/fusion/quadtree_store.hpp"

namespace fathom::fusion {
namespace {

constexpr int kSide = HeightTile::kSide;
constexpr int kMostLevels = 16;
// Steepest slope of extrapolation beyond the data: steeper ones are steps.
constexpr double kMaxSlope = 1.5;

// Nodes of one tile and one more around it, as means of cells under a tent as wide as the tile's spacing,
// each cell weighted by its area.
class NodeMeans {
 public:
  static constexpr int kMargin = 1;                             // nodes around the tile
  static constexpr int kNodes = kSide + 2 * kMargin;            // a side
  static constexpr int kRegion = kTileCells + 2 * kMargin + 2;  // cells a side that reach those nodes
  static constexpr int kFirst = -kMargin - 1;                   // the first of them

  NodeMeans(const QuadtreeStore& store, const TileKey& key) : store_(store), key_(key) {
    for (int n = -1; n <= 1; ++n)
      for (int e = -1; e <= 1; ++e) {
        const TileKey near{key.north_index + n, key.east_index + e, key.level};
        Areas areas{};
        gather(near, areas);
        for (int k = 0; k < kTileCells * kTileCells; ++k) {
          const int i = n * kTileCells + k / kTileCells, j = e * kTileCells + k % kTileCells;
          if (!inRegion(i, j)) continue;
          float& area = covered(i, j);
          area = areas[static_cast<std::size_t>(k)];
        }
      }
    for (int i = kFirst; i < kFirst + kRegion; ++i)
      for (int j = kFirst; j < kFirst + kRegion; ++j) showCoarser(i, j);
  }

  // Whether the tile's own cells have data.
  [[nodiscard]] bool any() const {
    for (int i = 0; i < kTileCells; ++i)
      for (int j = 0; j < kTileCells; ++j)
        if (covered_[regionIndex(i, j)] > 0) return true;
    return false;
  }

  [[nodiscard]] HeightTile::Node node(int i, int j) const {
    const Sum& sum = at(i, j);
    HeightTile::Node out;
    if (sum.area <= 0) return out;
    out.depth = static_cast<float>(sum.depth / sum.area - carried(i, j));
    out.sigma = static_cast<float>(std::sqrt(sum.variance) / sum.area);
    out.coverage = static_cast<float>(std::min(1.0, sum.area));  // a whole tent has area 1
    out.layered = sum.layered;
    for (std::size_t c = 0; c < 3; ++c)
      out.colour[c] = static_cast<std::uint8_t>(std::min(255.0, sum.colour[c] / sum.area + 0.5));
    return out;
  }

 private:
  using Areas = std::array<float, kTileCells * kTileCells>;
  // Tent-weighted; x northwards and y eastwards of the node, in spacings.
  struct Sum {
    double area = 0, depth = 0, variance = 0, x = 0, y = 0;
    std::array<double, 3> colour{};
    bool layered = false;
  };

  static bool inRegion(int i, int j) {
    return i >= kFirst && i < kFirst + kRegion && j >= kFirst && j < kFirst + kRegion;
  }
  static std::size_t regionIndex(int i, int j) {
    return static_cast<std::size_t>((i - kFirst) * kRegion + j - kFirst);
  }
  float& covered(int i, int j) { return covered_[regionIndex(i, j)]; }
  [[nodiscard]] const Sum& at(int i, int j) const {
    return sums_[static_cast<std::size_t>((i + kMargin) * kNodes + j + kMargin)];
  }

  // Gathers the square and those below it, finest first; gives the share of each cell's area with data.
  void gather(const TileKey& key, Areas& areas) {
    const std::int32_t found = store_.index().find(key);
    if (found == TileIndex::kAbsent || !reaches(key)) return;
    if (store_.index().below(key) > 0) {
      for (int c = 0; c < 4; ++c) {
        Areas finer{};
        gather(TileIndex::child(key, c), finer);
        for (int k = 0; k < kTileCells * kTileCells; ++k) {
          const int i = (c / 2 * kTileCells + k / kTileCells) / 2,
                    j = (c % 2 * kTileCells + k % kTileCells) / 2;
          areas[static_cast<std::size_t>(i * kTileCells + j)] += 0.25F * finer[static_cast<std::size_t>(k)];
        }
      }
    }
    if (found < 0) return;
    const Slots coarser = slotsAbove(key);
    const double step = std::exp2(key_.level - key.level);  // size of a cell in spacings of the tile
    const double x0 = (std::int64_t{key.north_index} - scaled(key_.north_index, key)) * kTileCells * step;
    const double y0 = (std::int64_t{key.east_index} - scaled(key_.east_index, key)) * kTileCells * step;
    for (int k = 0; k < kTileCells * kTileCells; ++k) {
      float& area = areas[static_cast<std::size_t>(k)];
      if (area >= 1) continue;
      CellReading cell = readCell(store_, key.level, store_.head(found, k));
      if (!cell.seen() || outvoted(cell, key, k, coarser)) continue;
      const int row = k / kTileCells, column = k % kTileCells;
      add(cell, x0 + (row + 0.5) * step, y0 + (column + 0.5) * step,
          static_cast<double>(1 - area) * step * step);
      area = 1;
    }
  }
  // Squares with sums over this one, by level.
  using Slots = std::array<std::int32_t, kMostLevels>;
  [[nodiscard]] Slots slotsAbove(const TileKey& key) const {
    Slots slots;
    slots.fill(QuadtreeStore::kNone);
    for (TileKey up = key; up.level > 0;) {
      up = TileIndex::parent(up);
      slots[static_cast<std::size_t>(up.level)] = store_.index().find(up);
    }
    return slots;
  }
  // Whether more meshes saw another surface at a coarser level; marks the cell where nearly as many did.
  bool outvoted(CellReading& cell, const TileKey& key, int k, const Slots& coarser) const {
    for (int level = 0; level < key.level; ++level) {
      const std::int32_t slot = coarser[static_cast<std::size_t>(level)];
      if (slot < 0) continue;
      const int down = key.level - level;
      const std::int64_t gi = (std::int64_t{key.north_index} * kTileCells + k / kTileCells) >> down;
      const std::int64_t gj = (std::int64_t{key.east_index} * kTileCells + k % kTileCells) >> down;
      const CellReading other = readCell(store_, level, store_.head(slot, cellOf(gi, gj)));
      const SurfaceVote outcome = vote(store_, cell, other, level);
      if (outcome == SurfaceVote::kStands || isBetween(cell, level, gi, gj)) continue;
      if (outcome == SurfaceVote::kOutvoted) return true;
      cell.layered = cell.layered || outcome == SurfaceVote::kLayered;
    }
    return false;
  }
  // Whether the height is between those of the coarse cells around: on a cliff the coarse cells are wrong,
  // not the finer one.
  [[nodiscard]] bool isBetween(const CellReading& cell, int level, std::int64_t gi, std::int64_t gj) const {
    bool above = false, below = false;
    for (int k = 0; k < 9; ++k) {
      const CellReading near = read(level, gi + k / 3 - 1, gj + k % 3 - 1);
      if (!near.seen()) return true;  // at the border of the coarse level's data nothing is decided
      above = above || near.depth <= cell.depth;
      below = below || near.depth >= cell.depth;
    }
    return above && below;
  }
  [[nodiscard]] std::int64_t scaled(std::int32_t index, const TileKey& below) const {
    return std::int64_t{index} << (below.level - key_.level);
  }
  // Whether a square of this level or finer reaches the nodes.
  [[nodiscard]] bool reaches(const TileKey& key) const {
    const int down = key.level - key_.level;
    const double size = kTileCells * std::exp2(-down);
    const double x = static_cast<double>(key.north_index - scaled(key_.north_index, key)) * size;
    const double y = static_cast<double>(key.east_index - scaled(key_.east_index, key)) * size;
    constexpr double kEnd = kFirst + kRegion;
    return x < kEnd && x + size > kFirst && y < kEnd && y + size > kFirst;
  }

  void add(const CellReading& cell, double x, double y, double area) {
    const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
    for (int c = 0; c < 4; ++c) {
      const int ni = i + c / 2, nj = j + c % 2;
      if (ni < -kMargin || ni >= kSide + kMargin || nj < -kMargin || nj >= kSide + kMargin) continue;
      const double dx = x - ni, dy = y - nj, tent = (1 - std::abs(dx)) * (1 - std::abs(dy)) * area;
      if (tent <= 0) continue;
      Sum& sum = sums_[static_cast<std::size_t>((ni + kMargin) * kNodes + nj + kMargin)];
      sum.area += tent;
      sum.depth += tent * cell.depth;
      sum.variance += tent * tent * cell.variance;
      sum.x += tent * dx;
      sum.y += tent * dy;
      for (std::size_t k = 0; k < 3; ++k) sum.colour[k] += tent * static_cast<double>(cell.colour[k]);
      sum.layered = sum.layered || cell.layered;
    }
  }

  // Without data as fine as the tile: the next coarser level with data at the place.
  void showCoarser(int i, int j) {
    float& area = covered(i, j);
    if (area >= 1) return;
    const std::int64_t gi = std::int64_t{key_.north_index} * kTileCells + i;
    const std::int64_t gj = std::int64_t{key_.east_index} * kTileCells + j;
    for (int level = key_.level - 1; level >= 0; --level) {
      const int down = key_.level - level;
      const std::int64_t ci = gi >> down, cj = gj >> down;
      CellReading cell = read(level, ci, cj);
      if (!cell.seen()) continue;
      const TileKey key = tileOf(level, ci, cj);
      if (outvoted(cell, key, cellOf(ci, cj), slotsAbove(key))) continue;
      // Middle of the fine cell, northwards and eastwards of the coarse cell's middle, in coarse cells.
      const double scale = std::exp2(-down);
      const double x = (static_cast<double>(gi - (ci << down)) + 0.5) * scale - 0.5;
      const double y = (static_cast<double>(gj - (cj << down)) + 0.5) * scale - 0.5;
      cell.depth = interpolate(level, ci, cj, cell, x, y);
      add(cell, i + 0.5, j + 0.5, static_cast<double>(1 - area));
      area = 1;
      return;
    }
  }

  static TileKey tileOf(int level, std::int64_t gi, std::int64_t gj) {
    return {static_cast<std::int32_t>(gi >> 4), static_cast<std::int32_t>(gj >> 4),
            static_cast<std::int16_t>(level)};
  }
  static int cellOf(std::int64_t gi, std::int64_t gj) {
    return static_cast<int>((gi & (kTileCells - 1)) * kTileCells + (gj & (kTileCells - 1)));
  }
  [[nodiscard]] CellReading read(int level, std::int64_t gi, std::int64_t gj) const {
    const std::int32_t slot = store_.index().find(tileOf(level, gi, gj));
    return slot < 0 ? CellReading{} : readCell(store_, level, store_.head(slot, cellOf(gi, gj)));
  }

  // Bilinear between the middles of four cells; where one was not seen, along the slope of those that were.
  [[nodiscard]] double interpolate(int level, std::int64_t ci, std::int64_t cj, const CellReading& cell,
                                   double x, double y) const {
    const int di = x < 0 ? -1 : 1, dj = y < 0 ? -1 : 1;
    const CellReading a = read(level, ci + di, cj), b = read(level, ci, cj + dj),
                      c = read(level, ci + di, cj + dj);
    const double u = std::abs(x), v = std::abs(y);
    if (a.seen() && b.seen() && c.seen())
      return (1 - u) * ((1 - v) * cell.depth + v * b.depth) + u * ((1 - v) * a.depth + v * c.depth);
    const auto slope = [&](const CellReading& ahead, int north, int east, double sign) {
      const double limit = kMaxSlope * store_.spacing(level);
      if (ahead.seen()) return std::clamp(sign * (ahead.depth - cell.depth), -limit, limit);
      const CellReading back = read(level, ci - north, cj - east);
      return back.seen() ? std::clamp(sign * (cell.depth - back.depth), -limit, limit) : 0.0;
    };
    return cell.depth + x * slope(a, di, 0, di) + y * slope(b, 0, dj, dj);
  }

  // Depth of the centre of a node's cells over that of the node, by the plane through the means around it. 0
  // where the cells are symmetric about the node.
  [[nodiscard]] double carried(int i, int j) const {
    const Sum& sum = at(i, j);
    const double ox = sum.x / sum.area, oy = sum.y / sum.area;
    if (std::abs(ox) + std::abs(oy) < 1e-9) return 0;
    double xx = 1e-6, xy = 0, yy = 1e-6, xh = 0, yh = 0;
    for (int k = 0; k < 9; ++k) {
      const int ni = i + k / 3 - 1, nj = j + k % 3 - 1;
      if (k == 4 || ni < -kMargin || ni >= kSide + kMargin || nj < -kMargin || nj >= kSide + kMargin)
        continue;
      const Sum& near = at(ni, nj);
      if (near.area <= 0) continue;
      const double dx = ni - i + near.x / near.area - ox, dy = nj - j + near.y / near.area - oy;
      const double dh = near.depth / near.area - sum.depth / sum.area;
      xx += dx * dx;
      xy += dx * dy;
      yy += dy * dy;
      xh += dx * dh;
      yh += dy * dh;
    }
    const double determinant = xx * yy - xy * xy, limit = kMaxSlope * store_.spacing(key_.level);
    if (determinant < 1e-3) return 0;  // the means around are on a line
    const double a = std::clamp((yy * xh - xy * yh) / determinant, -limit, limit);
    const double b = std::clamp((xx * yh - xy * xh) / determinant, -limit, limit);
    return a * ox + b * oy;
  }

  const QuadtreeStore& store_;
  TileKey key_;
  std::array<Sum, kNodes * kNodes> sums_{};
  std::array<float, kRegion * kRegion> covered_{};
};

}  // namespace

bool QuadtreeMap::extract(const TileKey& key, HeightTile& out) const {
  const QuadtreeStore& store = impl_->store;
  if (key.level < 0 || key.level > store.config().max_level) return false;
  // Without a square there or a coarser one over it there are no data.
  bool known = false;
  for (TileKey up = key; !known; up = TileIndex::parent(up)) {
    const std::int32_t found = store.index().find(up);
    known = found >= 0 || (up.level == key.level && found != TileIndex::kAbsent);
    if (up.level == 0) break;
  }
  if (!known) return false;
  const NodeMeans means(store, key);
  if (!means.any()) return false;
  out.north_index = key.north_index;
  out.east_index = key.east_index;
  out.level = key.level;
  out.size = store.tileSize(key.level);
  out.revision = impl_->revisionOf(key);
  for (int i = 0; i < kSide; ++i)
    for (int j = 0; j < kSide; ++j) out.at(i, j) = means.node(i, j);
  return true;
}

}  // namespace fathom::fusion
