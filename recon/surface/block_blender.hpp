#pragma once

#include <vector>

#include "recon/surface/bake.hpp"
#include "recon/surface/blend.hpp"
#include "recon/surface/chart_lattice.hpp"
#include "recon/surface/kernels/blend_kernels.hpp"
#include "recon/surface/view_vote.hpp"

namespace fathom::surface {

// Textures a chart square by square. Bands, weights and image positions are computed at the lattice's nodes;
// only the high band is sampled texel by texel, in the few views of relevant weight:
//   texel = [low + middle - sum of w_high G(s1)] + sum of w_high I, the bracket interpolated between nodes.
class BlockBlender {
 public:
  static constexpr int kCells = 16;  // of a block along one side

  BlockBlender(const BlendConfig& config, const BlendKernels& kernels) : config_(config), kernels_(kernels) {}

  // Shared by all blocks of a tile; kept until the next call.
  struct Tile {
    const ChartLattice* lattice = nullptr;
    const std::vector<ActiveView>* views = nullptr;
    const ViewVote* vote = nullptr;  // null: none
    RgbImage* atlas = nullptr;
    std::vector<std::uint32_t>* chosen = nullptr;  // null: not wanted
    float tolerance = 0;
  };
  void begin(const Tile& tile) { tile_ = tile; }

  // Cells [i0, i0 + kCells) x [j0, j0 + kCells) of a chart, cut at its border. `seen`: the chart's nodes;
  // those that a view sees become known with the colour of their lower bands.
  void blend(const Chart& chart, std::size_t place, int i0, int j0, ColourGrid& seen, BlendCounts& counts);

 private:
  void gatherNodes(const ChartLattice::Grid& grid, int i0, int j0);
  void look(std::size_t place, int i0, int j0, BlendCounts& counts);
  void weighViews();
  void takeBands();
  void writeCells(const Chart& chart, const ChartLattice::Grid& grid, int i0, int j0, BlendCounts& counts);
  void writeBest(const std::vector<CellView>& views, const CellTexels& texels, std::size_t first_texel);

  BlendConfig config_;
  const BlendKernels& kernels_;
  Tile tile_;

  int columns_ = 0, rows_ = 0, count_ = 0;  // nodes of the block
  std::vector<float> points_[6];            // x, y, z, nx, ny, nz
  std::vector<std::uint8_t> known_, seen_;
  Eigen::Vector3f middle_ = Eigen::Vector3f::Zero();
  float radius_ = 0;  // of the block's nodes around it [m]
  std::vector<std::uint32_t> meeting_,
      looking_;  // indices of the views that may see, and that see, part of the block
  // A row of count_ for each of them.
  std::vector<float> u_, v_, low_, middle_band_, high_;
  std::vector<float> depth_, centrality_, freedom_, factor_, sums_;
  std::vector<float> colour_, base_;  // four values a node
  std::vector<CellView> cell_views_;
};

}  // namespace fathom::surface
