#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <map>
#include <set>
#include <tuple>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/tile_mesh.hpp"

namespace fathom::test {

// A piece of one tile's border that the other tile does not have.
struct Crack {
  TileId tile, other;                   // `other`: across the side, or a child of `tile` on it
  std::array<Eigen::Vector3d, 2> ends;  // nav [m]
};

struct BorderReport {
  std::uint64_t tiles = 0, pairs = 0;  // pairs: neighbours of the same or different levels, compared
  std::uint64_t segments = 0;          // that both tiles of a pair have, to the last bit
  std::uint64_t ends = 0;              // that one has where the other has nothing: the data end at the side
  std::uint64_t off_lattice = 0;       // vertices that are not on TileGrid's lattice
  std::uint64_t crack_count = 0;
  std::vector<Crack> cracks;  // the first kMostCracks of them
  static constexpr std::size_t kMostCracks = 100;
};

// Whether tiles join without cracks: along the side between two tiles, of whatever levels, the borders of
// both meshes must be the same segments, run through in opposite directions. A border is taken with its
// direction and added up over the faces, so that what meets itself inside a tile counts for nothing, and
// doubled vertices (at seams of the texture) do not matter; TileMesh::shared is not used.
//
// A segment that only one tile has is a crack where the other has a segment of its own beside it (overlapping
// along the side by more than two steps of the lattice, no farther in depth than two voxels or the longer
// one's length), and the end of the data otherwise. What that leaves open is closed by the second rule: along
// its sides a tile has exactly the segments of its children, so that it ends where the finest level does.
class BorderCheck {
 public:
  explicit BorderCheck(const TileGrid& grid) : grid_(grid) {}

  // Keeps the segments on the tile's sides only. A tile that was added before is replaced.
  void add(const TileMesh& tile);
  // Compares each tile with all those across its sides and with its children.
  [[nodiscard]] BorderReport run() const;

 private:
  using Place = std::array<std::int32_t, 3>;  // steps of the lattice
  struct Segment {
    Place from, to;    // from < to
    std::int32_t net;  // times that faces run through it from `from` to `to`, less the opposite direction
  };
  static constexpr std::size_t kSides = 4;  // low north, high north, low east, high east
  using Sides = std::array<std::vector<Segment>, kSides>;

  void compare(const TileId& tile, std::size_t side, const TileId& other, BorderReport& report) const;
  void compareWithChildren(const TileId& tile, BorderReport& report) const;
  [[nodiscard]] std::vector<Segment> within(const std::vector<Segment>& all, std::size_t axis,
                                            const TileId& tile) const;
  void note(const TileId& tile, const TileId& other, const Segment& segment, BorderReport& report) const;

  TileGrid grid_;
  std::map<TileId, Sides> tiles_;
  std::uint64_t off_lattice_ = 0;
};

inline std::int32_t steps(double metres) {
  return static_cast<std::int32_t>(std::lround(metres / TileGrid::kLattice));
}

// The coordinate that is the same all along a side, and the one that runs along it (0 north, 1 east).
inline constexpr std::size_t across(std::size_t side) {
  return side / 2;
}
inline constexpr std::size_t along(std::size_t side) {
  return 1 - side / 2;
}

// Where two cells of the volumetric grid meet in an edge alone, the vertex there stands twice, a step of the
// lattice apart; if both tiles end there, their segments overlap by that much [steps].
inline constexpr std::int32_t kTouching = 2;

// The coordinates of a tile's sides.
inline std::array<std::int32_t, 4> planesOf(const TileGrid& grid, const TileId& tile) {
  const std::array<double, 4> box = grid.box(tile);
  return {steps(box[0]), steps(box[2]), steps(box[1]), steps(box[3])};
}

inline TileId beyond(const TileId& tile, std::size_t side) {
  TileId next = tile;
  (across(side) == 0 ? next.x : next.y) += side % 2 == 0 ? -1 : 1;
  return next;
}

inline void BorderCheck::add(const TileMesh& tile) {
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

inline std::vector<BorderCheck::Segment> BorderCheck::within(const std::vector<Segment>& all,
                                                             std::size_t axis, const TileId& tile) const {
  const std::array<double, 4> box = grid_.box(tile);
  const std::int32_t low = steps(box[axis]), high = steps(box[axis + 2]);
  std::vector<Segment> out;
  std::copy_if(all.begin(), all.end(), std::back_inserter(out), [&](const Segment& s) {
    return std::min(s.from[axis], s.to[axis]) >= low && std::max(s.from[axis], s.to[axis]) <= high;
  });
  return out;
}

inline void BorderCheck::note(const TileId& tile, const TileId& other, const Segment& segment,
                              BorderReport& report) const {
  ++report.crack_count;
  if (report.cracks.size() >= BorderReport::kMostCracks) return;
  const auto metres = [](const Place& p) -> Eigen::Vector3d {
    return Eigen::Vector3d(p[0], p[1], p[2]) * TileGrid::kLattice;
  };
  report.cracks.push_back({tile, other, {metres(segment.from), metres(segment.to)}});
}

inline void BorderCheck::compare(const TileId& tile, std::size_t side, const TileId& other,
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

inline void BorderCheck::compareWithChildren(const TileId& tile, BorderReport& report) const {
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

inline BorderReport BorderCheck::run() const {
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

struct Topology {
  std::size_t vertices = 0, edges = 0, faces = 0;
  std::size_t border_edges = 0, bad_edges = 0;  // of one face; of more than two, or of faces that disagree
  std::size_t components = 0;
  [[nodiscard]] long euler() const {
    return static_cast<long>(vertices) - static_cast<long>(edges) + static_cast<long>(faces);
  }
};

inline Topology topologyOf(const Mesh& mesh) {
  Topology out;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::pair<int, int>> edges;
  std::vector<std::uint32_t> part(mesh.vertices.size());
  for (std::uint32_t v = 0; v < part.size(); ++v) part[v] = v;
  const auto find = [&](std::uint32_t v) {
    while (part[v] != v) v = part[v] = part[part[v]];
    return v;
  };
  std::set<std::uint32_t> used;
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      used.insert(a);
      part[find(a)] = find(b);
      ++(a < b ? edges[{a, b}].first : edges[{b, a}].second);
    }
  out.vertices = used.size();
  out.edges = edges.size();
  out.faces = mesh.triangles.size();
  for (const auto& [key, n] : edges) {
    if (n.first + n.second == 1) ++out.border_edges;
    if (n.first > 1 || n.second > 1) ++out.bad_edges;
  }
  for (const std::uint32_t v : used)
    if (find(v) == v) ++out.components;
  return out;
}

}  // namespace fathom::test
