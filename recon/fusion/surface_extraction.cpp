#include "recon/fusion/surface_extraction.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "recon/fusion/marching_cubes.hpp"
#include "recon/geometry/tile_mesh.hpp"

namespace fathom::fusion {
namespace {

// Distances of neighbouring voxels differ by one voxel over the cosine of incidence. A greater step than this
// [voxels] is not a surface but the seam between the back of one mesh's band and the front of another's.
constexpr float kSteepest = 4.0F;
constexpr unsigned kAllCorners = 0xFF;
constexpr std::uint32_t kNoBlock = VoxelGrid::kNone;

// State of the extraction for a block.
struct BlockCells {
  static constexpr int kWords = VoxelBlock::kVoxels * 3 / 64;
  const VoxelBlock* block = nullptr;
  std::array<std::uint32_t, 8> after{};  // places of the blocks at (0|1, 0|1, 0|1); number dx + 2 dy + 4 dz
  // A bit for each z of the rows (x, y): seen, and inside.
  std::array<std::uint8_t, kBlockEdge * kBlockEdge> known{}, inside{};
  std::array<std::uint8_t, kBlockEdge * kBlockEdge> crossed{};  // cells that carry surface
  std::size_t first_cell = 0;                                   // in the list of crossed cells
  bool any_split = false;
  // A bit for each voxel edge with a vertex, and the number of the first vertex of each word.
  std::array<std::uint64_t, kWords> used{};
  std::array<std::uint32_t, kWords> first{};

  [[nodiscard]] std::uint32_t vertex(std::size_t edge) const {
    const std::uint64_t before = used[edge / 64] & ((std::uint64_t{1} << (edge % 64)) - 1);
    return first[edge / 64] + static_cast<std::uint32_t>(std::popcount(before));
  }
};

struct CrossedCell {
  std::uint16_t local;
  std::uint8_t signs;
};

struct VoxelEdge {
  std::uint32_t place;  // of the block where it begins
  std::size_t edge;     // 3 local + axis
};

class Extraction {
 public:
  Extraction(const VoxelGrid& grid, const ExtractionRule& rule) : rule_(rule) {
    std::vector<std::uint32_t> order(grid.keys().size());
    std::iota(order.begin(), order.end(), 0U);
    std::sort(order.begin(), order.end(),
              [&](std::uint32_t a, std::uint32_t b) { return grid.keys()[a] < grid.keys()[b]; });
    std::vector<std::uint32_t> place(order.size());
    for (std::uint32_t k = 0; k < order.size(); ++k) place[order[k]] = k;
    cells_.resize(order.size());
    for (std::size_t k = 0; k < order.size(); ++k) {
      const VoxelBlockKey& key = grid.keys()[order[k]];
      out_.parts.push_back({key, 0});
      cells_[k].block = &grid.block(order[k]);
      for (int n = 0; n < 8; ++n) {
        const std::uint32_t number = grid.number({key.x + (n & 1), key.y + (n >> 1 & 1), key.z + (n >> 2)});
        cells_[k].after[static_cast<std::size_t>(n)] = number == kNoBlock ? kNoBlock : place[number];
      }
    }
    before_.resize(order.size());
    for (auto& b : before_) b.fill(kNoBlock);
    for (std::uint32_t k = 0; k < cells_.size(); ++k)
      for (std::size_t n = 0; n < 8; ++n)
        if (cells_[k].after[n] != kNoBlock) before_[cells_[k].after[n]][n] = k;
  }

  ExtractedSurface run() {
    for (BlockCells& cells : cells_) readSigns(cells);
    for (BlockCells& cells : cells_) findCrossedCells(cells);
    for (std::uint32_t k = 0; k < cells_.size(); ++k) markEdges(k);
    for (std::uint32_t k = 0; k < cells_.size(); ++k) makeVertices(k);
    for (const Split& split : splits_) makeVertex(split.at, true);
    for (std::uint32_t k = 0; k < cells_.size(); ++k) makeTriangles(k);
    computeNormals(out_.mesh);
    return std::move(out_);
  }

 private:
  void readSigns(BlockCells& cells) const {
    const VoxelBlock& block = *cells.block;
    for (std::size_t row = 0; row < kBlockEdge * kBlockEdge; ++row) {
      unsigned known = 0, inside = 0;
      for (std::size_t z = 0; z < kBlockEdge; ++z) {
        const std::size_t v = row * kBlockEdge + z;
        known |= static_cast<unsigned>(block.weight[v] > 0 && block.observations[v] >= rule_.min_observations)
                 << z;
        inside |= static_cast<unsigned>(block.distance[v] < 0) << z;
      }
      cells.known[row] = static_cast<std::uint8_t>(known);
      cells.inside[row] = static_cast<std::uint8_t>(inside);
    }
  }

  // Nine bits of the row at (x, y), both up to 8, of a block's own and its neighbours' rows.
  unsigned row(const BlockCells& cells, auto rows, int x, int y) const {
    const auto at = static_cast<std::size_t>((x >> 3) | (y >> 3) << 1);
    const auto local = static_cast<std::size_t>((x & 7) * kBlockEdge + (y & 7));
    const std::uint32_t here = cells.after[at], above = cells.after[at + 4];
    unsigned bits = here == kNoBlock ? 0U : (cells_[here].*rows)[local];
    if (above != kNoBlock) bits |= ((cells_[above].*rows)[local] & 1U) << kBlockEdge;
    return bits;
  }

  void findCrossedCells(BlockCells& cells) {
    cells.first_cell = crossed_.size();
    std::array<std::array<unsigned, kBlockEdge + 1>, kBlockEdge + 1> known, inside;
    unsigned any = 0, all = ~0U;
    for (int x = 0; x <= kBlockEdge; ++x) {
      for (int y = 0; y <= kBlockEdge; ++y) {
        const auto i = static_cast<std::size_t>(x), j = static_cast<std::size_t>(y);
        known[i][j] = row(cells, &BlockCells::known, x, y);
        inside[i][j] = row(cells, &BlockCells::inside, x, y) & known[i][j];
        any |= inside[i][j];
        all &= inside[i][j] | ~known[i][j];
      }
    }
    constexpr unsigned kRow = (1U << (kBlockEdge + 1)) - 1;
    if (any == 0 || (all & kRow) == kRow) return;
    for (std::size_t x = 0; x < kBlockEdge; ++x) {
      for (std::size_t y = 0; y < kBlockEdge; ++y) {
        const std::array<std::size_t, 4> xs = {x, x + 1, x, x + 1}, ys = {y, y, y + 1, y + 1};
        unsigned unseen = 0, more_unseen = 0, some = 0, full = kRow;
        for (std::size_t c = 0; c < 4; ++c) {
          const unsigned column = known[xs[c]][ys[c]];
          for (const unsigned blank : {~column, ~(column >> 1)}) {
            more_unseen |= unseen & blank;
            unseen |= blank;
          }
          some |= inside[xs[c]][ys[c]];
          full &= inside[xs[c]][ys[c]];
        }
        unsigned candidates = ~more_unseen & (some | some >> 1) & ~(full & full >> 1) & 0xFFU;
        for (; candidates != 0; candidates &= candidates - 1) {
          const auto z = static_cast<unsigned>(std::countr_zero(candidates));
          unsigned signs = 0, seen = 0;
          for (std::size_t c = 0; c < 4; ++c) {
            const unsigned bits = inside[xs[c]][ys[c]] >> z, known_bits = known[xs[c]][ys[c]] >> z;
            signs |= (bits & 1U) << c | (bits >> 1 & 1U) << (c + 4);
            seen |= (known_bits & 1U) << c | (known_bits >> 1 & 1U) << (c + 4);
          }
          if (seen != kAllCorners && !signOfUnseen(seen, signs)) continue;
          const auto local = static_cast<std::uint16_t>((x * kBlockEdge + y) * kBlockEdge + z);
          if (tooSteep(cells, local, signs)) continue;
          crossed_.push_back({local, static_cast<std::uint8_t>(signs)});
          cells.crossed[local / kBlockEdge] |= static_cast<std::uint8_t>(1U << z);
        }
      }
    }
  }

  // For a cell with one unknown corner: true if the surface cuts off the opposite corner and thus does not
  // depend on the unknown one, which gets the others' sign. False: the surface may depend on it.
  static bool signOfUnseen(unsigned seen, unsigned& signs) {
    const unsigned unseen = kAllCorners & ~seen;
    const unsigned opposite = 1U << (7 - std::countr_zero(unseen));
    if (signs == opposite) return true;
    if ((signs ^ seen) != opposite) return false;
    signs |= unseen;
    return true;
  }

  [[nodiscard]] bool tooSteep(const BlockCells& cells, std::uint16_t local, unsigned signs) const {
    const float steepest = kSteepest * static_cast<float>(rule_.voxel);
    std::array<float, 8> d{};
    for (int c = 0; c < 8; ++c) {
      const Corner at = corner(local, c);
      if (cells.after[neighbour(at)] != kNoBlock) d[static_cast<std::size_t>(c)] = distance(cells, at);
    }
    for (std::size_t e = 0; e < MarchingCubesTable::kEdges; ++e) {
      const auto& edge = table_.edge(e);
      if (((signs >> edge.from ^ signs >> edge.to) & 1U) != 0 &&
          std::abs(d[edge.from] - d[edge.to]) > steepest)
        return true;
    }
    return false;
  }

  struct Corner {
    int x, y, z;  // from the block's first voxel, up to 8
  };
  static Corner corner(std::uint16_t local, int c) {
    return {(local >> 6) + (c & 1), (local >> 3 & 7) + (c >> 1 & 1), (local & 7) + (c >> 2)};
  }
  static std::size_t neighbour(const Corner& at) {
    return static_cast<std::size_t>((at.x >> 3) | (at.y >> 3) << 1 | (at.z >> 3) << 2);
  }
  static std::size_t localOf(const Corner& at) { return VoxelBlock::local(at.x & 7, at.y & 7, at.z & 7); }
  [[nodiscard]] float distance(const BlockCells& cells, const Corner& at) const {
    return cells_[cells.after[neighbour(at)]].block->distance[localOf(at)];
  }

  [[nodiscard]] VoxelEdge edgeOf(const BlockCells& cells, std::uint16_t local, std::uint8_t index) const {
    const auto& edge = table_.edge(index);
    const Corner from = corner(local, edge.from);
    return {cells.after[neighbour(from)], localOf(from) * 3 + edge.axis};
  }

  [[nodiscard]] std::size_t cellsEnd(std::uint32_t place) const {
    return place + 1 < cells_.size() ? cells_[place + 1].first_cell : crossed_.size();
  }

  void markEdges(std::uint32_t place) {
    for (std::size_t k = cells_[place].first_cell; k < cellsEnd(place); ++k) {
      const CrossedCell& cell = crossed_[k];
      for (std::uint8_t e = 0; e < MarchingCubesTable::kEdges; ++e) {
        const auto& edge = table_.edge(e);
        if (((cell.signs >> edge.from ^ cell.signs >> edge.to) & 1) == 0) continue;
        const VoxelEdge at = edgeOf(cells_[place], cell.local, e);
        cells_[at.place].used[at.edge / 64] |= std::uint64_t{1} << (at.edge % 64);
      }
    }
  }

  // Whether the cell at coordinates from -1 to 7 of a block carries surface.
  [[nodiscard]] bool isCrossed(std::uint32_t place, const std::array<int, 3>& at) const {
    const auto n = static_cast<std::size_t>((at[0] < 0) | (at[1] < 0) << 1 | (at[2] < 0) << 2);
    const std::uint32_t in = before_[place][n];
    if (in == kNoBlock) return false;
    return (cells_[in].crossed[static_cast<std::size_t>((at[0] & 7) * kBlockEdge + (at[1] & 7))] >>
                (at[2] & 7) &
            1) != 0;
  }

  // Whether two of the four cells around a voxel edge carry surface and meet in that edge alone.
  [[nodiscard]] bool isSplit(std::uint32_t place, int edge) const {
    const int axis = edge % 3, local = edge / 3;
    const std::array<int, 3> from = {local >> 6, local >> 3 & 7, local & 7};
    const std::size_t b = axis == 0 ? 1 : 0, c = axis == 2 ? 1 : 2;
    unsigned around = 0;
    for (unsigned n = 0; n < 4; ++n) {
      std::array<int, 3> at = from;
      at[b] -= static_cast<int>(n & 1);
      at[c] -= static_cast<int>(n >> 1);
      around |= static_cast<unsigned>(isCrossed(place, at)) << n;
    }
    return around == 0b1001U || around == 0b0110U;
  }

  void makeVertices(std::uint32_t place) {
    BlockCells& cells = cells_[place];
    for (std::size_t word = 0; word < BlockCells::kWords; ++word) {
      cells.first[word] = static_cast<std::uint32_t>(out_.mesh.vertices.size());
      for (std::uint64_t bits = cells.used[word]; bits != 0; bits &= bits - 1) {
        const int edge = static_cast<int>(word * 64) + std::countr_zero(bits);
        const VoxelEdge at{place, static_cast<std::size_t>(edge)};
        makeVertex(at, false);
        if (!isSplit(place, edge)) continue;
        cells.any_split = true;
        splits_.push_back({at});
      }
    }
  }

  void makeVertex(const VoxelEdge& where, bool second) {
    const BlockCells& cells = cells_[where.place];
    const std::size_t axis = where.edge % 3, local = where.edge / 3;
    const Corner from = corner(static_cast<std::uint16_t>(local), 0);
    const Corner to = corner(static_cast<std::uint16_t>(local), 1 << axis);
    const VoxelBlock &one = *cells.block, &other = *cells_[cells.after[neighbour(to)]].block;
    const std::size_t a = local, b = localOf(to);
    const float s = one.distance[a] / (one.distance[a] - other.distance[b]);
    const VoxelBlockKey& key = out_.parts[where.place].block;
    const std::array<int, 3> voxel = {key.x * kBlockEdge + from.x, key.y * kBlockEdge + from.y,
                                      key.z * kBlockEdge + from.z};
    Eigen::Vector3f at;
    for (std::size_t k = 0; k < 3; ++k)
      at[static_cast<int>(k)] =
          static_cast<float>(coordinate(voxel[k], k == axis ? s : 0.0F, k == axis, second));
    out_.mesh.vertices.push_back(at);
    const float wa = (1 - s) * one.weight[a], wb = s * other.weight[b];
    out_.mesh.sigma.push_back(1.0F / std::sqrt(wa + wb));
    // Colours by weight too: a voxel of little weight counts little.
    Rgb colour;
    for (std::size_t c = 0; c < 3; ++c) {
      const float mean = (wa * one.colour[c][a] + wb * other.colour[c][b]) / (wa + wb);
      colour[c] = static_cast<std::uint8_t>(std::min(255.0F, mean / 256.0F + 0.5F));
    }
    out_.mesh.colours.push_back(colour);
    out_.views.push_back(std::max(one.observations[a], other.observations[b]));
    out_.home.push_back(where.place);
    out_.planes.push_back(
        static_cast<std::uint8_t>((from.x == 0 && axis != 0) | (from.y == 0 && axis != 1) << 1));
  }

  // Of a point a part `s` of a voxel edge beyond a voxel, along one axis [m].
  [[nodiscard]] double coordinate(int voxel, float s, bool along, bool second) const {
    if (!rule_.snap) return (voxel + static_cast<double>(s)) * rule_.voxel;
    const double step = TileGrid::kLattice;
    const auto lattice = [&](double v) { return std::nearbyint(v * rule_.voxel / step); };
    if (!along) return lattice(voxel) * step;
    // The second of two vertices stands one step further; both stay inside the edge.
    const double first =
        std::clamp(lattice(voxel + static_cast<double>(s)), lattice(voxel) + 1, lattice(voxel + 1) - 2);
    return (first + (second ? 1 : 0)) * step;
  }

  [[nodiscard]] std::uint32_t vertexOf(const BlockCells& cells, std::uint16_t local,
                                       std::uint8_t index) const {
    const VoxelEdge at = edgeOf(cells, local, index);
    const BlockCells& owner = cells_[at.place];
    if (owner.any_split) {
      const auto& edge = table_.edge(index);
      const int last_axis = edge.axis == 2 ? 1 : 2;
      const bool further = (edge.from >> last_axis & 1) == 0;  // the cell is beyond the edge along that axis
      const auto found = std::lower_bound(splits_.begin(), splits_.end(), Split{at});
      if (further && found != splits_.end() && !(Split{at} < *found))
        return static_cast<std::uint32_t>(out_.mesh.vertices.size() - splits_.size() +
                                          static_cast<std::size_t>(found - splits_.begin()));
    }
    return owner.vertex(at.edge);
  }

  void makeTriangles(std::uint32_t place) {
    out_.parts[place].first_triangle = out_.mesh.triangles.size();
    for (std::size_t k = cells_[place].first_cell; k < cellsEnd(place); ++k) {
      const CrossedCell& cell = crossed_[k];
      const MarchingCubesTable::Pattern& pattern = table_.pattern(cell.signs);
      for (std::size_t t = 0; t < pattern.triangles; ++t) {
        std::array<std::uint32_t, 3> triangle;
        for (std::size_t c = 0; c < 3; ++c)
          triangle[c] = vertexOf(cells_[place], cell.local, pattern.edge[t][c]);
        out_.mesh.triangles.push_back(triangle);
      }
    }
  }

  struct Split {
    VoxelEdge at;
    bool operator<(const Split& other) const {
      return at.place != other.at.place ? at.place < other.at.place : at.edge < other.at.edge;
    }
  };

  ExtractionRule rule_;
  MarchingCubesTable table_;
  std::vector<BlockCells> cells_;
  std::vector<std::array<std::uint32_t, 8>> before_;  // places of the blocks at (0|-1, 0|-1, 0|-1)
  std::vector<CrossedCell> crossed_;                  // by block
  std::vector<Split> splits_;                         // voxel edges with two vertices, ascending
  ExtractedSurface out_;
};

}  // namespace

ExtractedSurface extractSurface(const VoxelGrid& grid, const ExtractionRule& rule) {
  return Extraction(grid, rule).run();
}

}  // namespace fathom::fusion
