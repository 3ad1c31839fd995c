#include "recon/fusion/cell_reading.hpp"

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

}  // namespace fathom::fusion
