#include "recon/fusion/space_division.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace fathom::fusion {
namespace {

// Costs of a cut, in meshes that are fused twice because of it.
constexpr double kClosureCost = 4;   // one severed: its two passes may meet with a step at the border
constexpr double kTransectCost = 2;  // one crossed
// Cost of a cut with nothing on one side, times all meshes; otherwise in proportion to the imbalance squared:
// a tenth more on one side costs half a percent, about a transect's width in a dense survey.
constexpr double kImbalanceCost = 2;
// Between target and limit a region is cut only where that costs less than this share of its meshes.
constexpr double kCheap = 0.25;
constexpr std::int64_t kMaxTiles = 64 * 64;  // of a piece: limits pieces with few meshes over wide gaps
constexpr double kReach = 1e6;               // [m]: a mesh beyond is an error and left out

// Along one axis, in tiles.
struct Span {
  std::int32_t low = 0, high = 0;  // [low, high)
};
struct Item {
  std::uint32_t mesh = 0;
  std::array<Span, 2> core, reach;  // tiles that it touches; with the overlap
};
// A range that a cut at c severs where low < c < high [tiles].
struct Link {
  std::array<double, 2> low{}, high{};
  double cost = 0;
};
struct Region {
  std::array<Span, 2> span;
  std::vector<Item> items;
  std::vector<Link> links;
};
struct Cut {
  int axis = 0;
  std::int32_t at = 0;
  double burden = 0;  // meshes twice, closures, transects
  double cost = 0;    // with the imbalance
};

bool meets(const Span& a, const Span& b) {
  return a.low < b.high && b.low < a.high;
}

std::optional<Item> itemOf(std::uint32_t mesh, const MeshFootprint& footprint, double edge, double overlap) {
  Item item{mesh, {}, {}};
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const double low = footprint.box[axis], high = footprint.box[axis + 2];
    if (!(low <= high && std::abs(low) < kReach && std::abs(high) < kReach)) return std::nullopt;
    const auto tile = [&](double v) { return static_cast<std::int32_t>(std::floor(v / edge)); };
    item.core[axis] = {tile(low), tile(high) + 1};
    item.reach[axis] = {tile(low - overlap), tile(high + overlap) + 1};
  }
  return item;
}

// Closures: the ground that both meshes cover, or that between them, should not be cut.
Link closureOf(const MeshFootprint& a, const MeshFootprint& b, double edge) {
  Link link;
  link.cost = kClosureCost;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const double from = std::max(a.box[axis], b.box[axis]) / edge;
    const double to = std::min(a.box[axis + 2], b.box[axis + 2]) / edge;
    link.low[axis] = std::min(from, to);
    link.high[axis] = std::max(from, to);
  }
  return link;
}

// From one mesh's middle to the next one's, where they meet.
std::optional<Link> transectOf(const MeshFootprint& a, const MeshFootprint& b, double edge) {
  Link link;
  link.cost = kTransectCost;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    if (a.box[axis] > b.box[axis + 2] || b.box[axis] > a.box[axis + 2]) return std::nullopt;
    const double from = (a.box[axis] + a.box[axis + 2]) / 2 / edge;
    const double to = (b.box[axis] + b.box[axis + 2]) / 2 / edge;
    link.low[axis] = std::min(from, to);
    link.high[axis] = std::max(from, to);
  }
  return link;
}

// Numbers at the places low, low + 1, ... high, added to over intervals.
class Steps {
 public:
  explicit Steps(const Span& span)
      : low_(span.low), add_(static_cast<std::size_t>(span.high - span.low) + 2) {}
  void over(std::int32_t first, std::int32_t last, double value) {  // inclusive
    const auto top = static_cast<std::int32_t>(add_.size()) - 2 + low_;
    first = std::max(first, low_);
    last = std::min(last, top);
    if (first > last) return;
    add_[static_cast<std::size_t>(first - low_)] += value;
    add_[static_cast<std::size_t>(last - low_) + 1] -= value;
  }
  [[nodiscard]] std::vector<double> sums() const {
    std::vector<double> out(add_.size() - 1);
    double sum = 0;
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = sum += add_[k];
    return out;
  }

 private:
  std::int32_t low_;
  std::vector<double> add_;
};

std::optional<Cut> bestCut(const Region& region, int axis) {
  const auto a = static_cast<std::size_t>(axis);
  const Span& span = region.span[a];
  if (span.high - span.low < 2) return std::nullopt;
  Steps left(span), right(span), severed(span);
  for (const Item& item : region.items) {
    left.over(item.reach[a].low + 1, span.high, 1);
    right.over(span.low, item.reach[a].high - 1, 1);
  }
  for (const Link& link : region.links)
    severed.over(static_cast<std::int32_t>(std::floor(link.low[a])) + 1,
                 static_cast<std::int32_t>(std::ceil(link.high[a])) - 1, link.cost);
  const std::vector<double> l = left.sums(), r = right.sums(), s = severed.sums();
  const auto all = static_cast<double>(region.items.size());
  std::optional<Cut> best;
  for (std::int32_t at = span.low + 1; at < span.high; ++at) {
    const auto k = static_cast<std::size_t>(at - span.low);
    const double imbalance = (l[k] - r[k]) / (l[k] + r[k]);
    // Of equals the one that leaves the squarer tiles.
    const double middle = std::abs(2.0 * at - span.low - span.high) / (span.high - span.low);
    Cut cut{axis, at, l[k] + r[k] - all + s[k], 0};
    cut.cost = cut.burden + all * kImbalanceCost * (imbalance * imbalance + 1e-6 * middle);
    if (!best || cut.cost < best->cost) best = cut;
  }
  return best;
}

std::optional<Cut> bestCut(const Region& region) {
  const auto x = bestCut(region, 0), y = bestCut(region, 1);
  if (!x || !y) return x ? x : y;
  if (x->cost != y->cost) return x->cost < y->cost ? x : y;
  return region.span[0].high - region.span[0].low >= region.span[1].high - region.span[1].low ? x : y;
}

// The tiles that meshes themselves touch.
void trim(Region& region) {
  std::array<Span, 2> used;
  bool any = false;
  for (const Item& item : region.items) {
    if (!meets(item.core[0], region.span[0]) || !meets(item.core[1], region.span[1])) continue;
    for (std::size_t a = 0; a < 2; ++a) {
      const std::int32_t low = std::max(item.core[a].low, region.span[a].low);
      const std::int32_t high = std::min(item.core[a].high, region.span[a].high);
      used[a] = any ? Span{std::min(used[a].low, low), std::max(used[a].high, high)} : Span{low, high};
    }
    any = true;
  }
  region.span = used;
  std::erase_if(region.items, [&](const Item& item) {
    return !meets(item.reach[0], used[0]) || !meets(item.reach[1], used[1]);
  });
  std::erase_if(region.links, [&](const Link& link) {
    for (std::size_t a = 0; a < 2; ++a)
      if (link.high[a] <= used[a].low || link.low[a] >= used[a].high) return true;
    return false;
  });
}

// Whether all meshes reach one tile: then some piece has them all however the region is cut.
bool allMeetInOneTile(const Region& region) {
  for (std::size_t a = 0; a < 2; ++a) {
    Span common = region.span[a];
    for (const Item& item : region.items) {
      common.low = std::max(common.low, item.reach[a].low);
      common.high = std::min(common.high, item.reach[a].high);
    }
    if (common.low >= common.high) return false;
  }
  return true;
}

bool shouldCut(const Region& region, const Cut& cut, const DivisionConfig& config) {
  const auto meshes = static_cast<int>(region.items.size());
  const std::int64_t tiles = static_cast<std::int64_t>(region.span[0].high - region.span[0].low) *
                             (region.span[1].high - region.span[1].low);
  if (tiles > kMaxTiles) return true;
  if (meshes > config.max_meshes) return !allMeetInOneTile(region);
  return meshes > config.target_meshes && cut.burden < kCheap * meshes;
}

Region side(const Region& region, const Cut& cut, bool high) {
  const auto a = static_cast<std::size_t>(cut.axis);
  Region out{region.span, region.items, region.links};
  (high ? out.span[a].low : out.span[a].high) = cut.at;
  trim(out);
  return out;
}

}  // namespace

std::vector<Piece> divideSpace(const std::vector<MeshFootprint>& meshes,
                               const std::vector<std::pair<std::uint32_t, std::uint32_t>>& closures,
                               const TileGrid& grid, const DivisionConfig& config) {
  const double edge = grid.edge(0);
  Region all;
  std::vector<bool> usable(meshes.size());
  std::optional<std::uint32_t> before;
  for (std::uint32_t k = 0; k < meshes.size(); ++k) {
    const auto item = itemOf(k, meshes[k], edge, std::max(0.0, config.overlap));
    if (!item) continue;
    usable[k] = true;
    all.items.push_back(*item);
    if (before)
      if (const auto link = transectOf(meshes[*before], meshes[k], edge)) all.links.push_back(*link);
    before = k;
  }
  if (all.items.empty()) return {};
  for (const auto& [a, b] : closures)
    if (a < usable.size() && b < usable.size() && usable[a] && usable[b])
      all.links.push_back(closureOf(meshes[a], meshes[b], edge));
  for (std::size_t a = 0; a < 2; ++a) {
    all.span[a] = all.items.front().core[a];
    for (const Item& item : all.items)
      all.span[a] = {std::min(all.span[a].low, item.core[a].low),
                     std::max(all.span[a].high, item.core[a].high)};
  }

  std::vector<Piece> pieces;
  std::vector<Region> open;
  open.push_back(std::move(all));
  while (!open.empty()) {
    const Region region = std::move(open.back());
    open.pop_back();
    if (region.items.empty()) continue;
    const auto cut = bestCut(region);
    if (cut && shouldCut(region, *cut, config)) {
      open.push_back(side(region, *cut, true));
      open.push_back(side(region, *cut, false));
      continue;
    }
    Piece piece{{region.span[0].low, region.span[1].low, region.span[0].high, region.span[1].high}, {}};
    for (const Item& item : region.items) piece.meshes.push_back(item.mesh);
    pieces.push_back(std::move(piece));
  }
  return pieces;
}

}  // namespace fathom::fusion
