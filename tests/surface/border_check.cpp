#include "tests/surface/border_check.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <tuple>

namespace fathom::test {
namespace {

std::int32_t steps(double metres) {
  return static_cast<std::int32_t>(std::lround(metres / TileGrid::kLattice));
}

// The coordinate that is the same all along a side, and the one that runs along it (0 north, 1 east).
constexpr std::size_t across(std::size_t side) {
  return side / 2;
}
constexpr std::size_t along(std::size_t side) {
  return 1 - side / 2;
}

// Where two cells of the volumetric grid meet in an edge alone, the vertex there stands twice, a step of the
// lattice apart; if both tiles end there, their segments overlap by that much [steps].
constexpr std::int32_t kTouching = 2;

// The coordinates of a tile's sides.
std::array<std::int32_t, 4> planesOf(const TileGrid& grid, const TileId& tile) {
  const std::array<double, 4> box = grid.box(tile);
  return {steps(box[0]), steps(box[2]), steps(box[1]), steps(box[3])};
}

TileId beyond(const TileId& tile, std::size_t side) {
  TileId next = tile;
  (across(side) == 0 ? next.x : next.y) += side % 2 == 0 ? -1 : 1;
  return next;
}

}  // namespace

void BorderCheck::add(const TileMesh& tile) {
  const std::array<std::int32_t, 4> planes = planesOf(grid_, tile.tile);
  std::vector<Place> place;
  std::vector<std::uint8_t> on;  // a bit for each side
  for (const Eigen::Vector3f& v : tile.mesh.vertices) {
    Place p;
    bool exact = true;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto value = static_cast<double>(v[static_cast<int>(k)]);
      p[k] = steps(value);
      exact = exact && p[k] * TileGrid::kLattice == value;
    }
    unsigned bits = 0;
    for (std::size_t side = 0; side < kSides && exact; ++side)
      if (p[across(side)] == planes[side]) bits |= 1U << side;
    off_lattice_ += exact ? 0 : 1;
    place.push_back(p);
    on.push_back(static_cast<std::uint8_t>(bits));
  }
  Sides& sides = tiles_[tile.tile];
  sides = {};
  for (const auto& t : tile.mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      if ((on[a] & on[b]) == 0 || place[a] == place[b]) continue;
      const Segment segment =
          place[a] < place[b] ? Segment{place[a], place[b], 1} : Segment{place[b], place[a], -1};
      for (std::size_t side = 0; side < kSides; ++side)
        if (((on[a] & on[b]) >> side & 1) != 0) sides[side].push_back(segment);
    }
  for (std::vector<Segment>& segments : sides) {
    std::sort(segments.begin(), segments.end(), [](const Segment& a, const Segment& b) {
      return a.from != b.from ? a.from < b.from : a.to < b.to;
    });
    std::size_t kept = 0;
    for (std::size_t first = 0, last = 0; first < segments.size(); first = last) {
      Segment sum = segments[first];
      for (last = first + 1;
           last < segments.size() && segments[last].from == sum.from && segments[last].to == sum.to; ++last)
        sum.net += segments[last].net;
      if (sum.net != 0) segments[kept++] = sum;
    }
    segments.resize(kept);
    segments.shrink_to_fit();
  }
}

std::vector<BorderCheck::Segment> BorderCheck::within(const std::vector<Segment>& all, std::size_t axis,
                                                      const TileId& tile) const {
  const std::array<double, 4> box = grid_.box(tile);
  const std::int32_t low = steps(box[axis]), high = steps(box[axis + 2]);
  std::vector<Segment> out;
  std::copy_if(all.begin(), all.end(), std::back_inserter(out), [&](const Segment& s) {
    return std::min(s.from[axis], s.to[axis]) >= low && std::max(s.from[axis], s.to[axis]) <= high;
  });
  return out;
}

void BorderCheck::note(const TileId& tile, const TileId& other, const Segment& segment,
                       BorderReport& report) const {
  ++report.crack_count;
  if (report.cracks.size() >= BorderReport::kMostCracks) return;
  const auto metres = [](const Place& p) -> Eigen::Vector3d {
    return Eigen::Vector3d(p[0], p[1], p[2]) * TileGrid::kLattice;
  };
  report.cracks.push_back({tile, other, {metres(segment.from), metres(segment.to)}});
}

void BorderCheck::compare(const TileId& tile, std::size_t side, const TileId& other,
                          BorderReport& report) const {
  const std::size_t axis = along(side);
  const std::vector<Segment>& own = tiles_.at(tile)[side];
  const std::vector<Segment>& facing = tiles_.at(other)[side ^ 1];
  const std::vector<Segment> theirs = tile.level == other.level ? facing : within(facing, axis, tile);
  ++report.pairs;

  // What is left when each segment of ours takes away one of theirs.
  std::array<std::vector<Segment>, 2> left;
  std::size_t i = 0, j = 0;
  while (i < own.size() || j < theirs.size()) {
    const auto key = [](const Segment& s) { return std::pair{s.from, s.to}; };
    if (j == theirs.size() || (i < own.size() && key(own[i]) < key(theirs[j]))) {
      left[0].push_back(own[i++]);
    } else if (i == own.size() || key(theirs[j]) < key(own[i])) {
      left[1].push_back(theirs[j++]);
    } else {
      if (own[i].net + theirs[j].net == 0) {
        ++report.segments;
      } else {
        left[0].push_back(own[i]);
        left[1].push_back(theirs[j]);
      }
      ++i;
      ++j;
    }
  }
  const auto length = [](const Segment& s) {
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) sum += std::pow(static_cast<double>(s.to[k] - s.from[k]), 2);
    return std::sqrt(sum);
  };
  const double two_voxels = 2 * grid_.voxel / TileGrid::kLattice;
  const auto beside = [&](const Segment& a, const Segment& b) {
    const auto overlap = [&](std::size_t k) {
      return std::min(std::max(a.from[k], a.to[k]), std::max(b.from[k], b.to[k])) -
             std::max(std::min(a.from[k], a.to[k]), std::min(b.from[k], b.to[k]));
    };
    // Upright ones have no length along the side, and stand beside each other in depth.
    const auto upright = [&](const Segment& s) { return std::abs(s.to[axis] - s.from[axis]) <= kTouching; };
    if (upright(a) && upright(b)) return overlap(axis) >= 0 && overlap(2) > kTouching;
    return (upright(a) || upright(b) ? overlap(axis) >= 0 : overlap(axis) > kTouching) &&
           -overlap(2) <= std::max({two_voxels, length(a), length(b)});
  };
  for (std::size_t n = 0; n < 2; ++n)
    for (const Segment& segment : left[n]) {
      const bool crack = std::any_of(left[1 - n].begin(), left[1 - n].end(),
                                     [&](const Segment& s) { return beside(segment, s); });
      if (crack)
        note(n == 0 ? tile : other, n == 0 ? other : tile, segment, report);
      else
        ++report.ends;
    }
}

void BorderCheck::compareWithChildren(const TileId& tile, BorderReport& report) const {
  const std::int32_t fan = TileGrid::kFanOut;
  bool any = false;
  for (std::size_t side = 0; side < kSides; ++side) {
    std::vector<Segment> all;
    for (std::int32_t k = 0; k < fan; ++k) {
      TileId child{tile.level - 1, fan * tile.x, fan * tile.y};
      (across(side) == 0 ? child.x : child.y) += side % 2 == 0 ? 0 : fan - 1;
      (across(side) == 0 ? child.y : child.x) += k;
      const auto found = tiles_.find(child);
      if (found == tiles_.end()) continue;
      any = true;
      all.insert(all.end(), found->second[side].begin(), found->second[side].end());
    }
    if (!any) continue;
    const auto key = [](const Segment& s) { return std::tuple{s.from, s.to, s.net}; };
    const auto before = [&](const Segment& a, const Segment& b) { return key(a) < key(b); };
    std::sort(all.begin(), all.end(), before);
    const std::vector<Segment>& own = tiles_.at(tile)[side];
    std::vector<Segment> differing;
    std::set_symmetric_difference(own.begin(), own.end(), all.begin(), all.end(),
                                  std::back_inserter(differing), before);
    for (const Segment& segment : differing)
      note(tile, {tile.level - 1, fan * tile.x, fan * tile.y}, segment, report);
  }
}

BorderReport BorderCheck::run() const {
  BorderReport report;
  report.tiles = tiles_.size();
  report.off_lattice = off_lattice_;
  if (tiles_.empty()) return report;
  const int coarsest = tiles_.rbegin()->first.level;
  for (const auto& [tile, sides] : tiles_) {
    for (std::size_t side = 0; side < kSides; ++side) {
      // Across the side: a tile of the same level, or a coarser one with a side in the same plane. Of two
      // tiles of one level the lower is asked once.
      TileId inside = tile, outside = beyond(tile, side);
      for (int level = tile.level; level <= coarsest; ++level) {
        const bool once = level > tile.level || side % 2 == 1;
        if (once && tiles_.contains(outside)) compare(tile, side, outside, report);
        inside = TileGrid::parent(inside);
        outside = TileGrid::parent(outside);
        if (inside == outside) break;
      }
    }
    if (tile.level > 0) compareWithChildren(tile, report);
  }
  return report;
}

}  // namespace fathom::test
