#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "realtime/base/numbers/instruction_sets.hpp"
#include "recon/surface/band_image.hpp"
#include "recon/surface/view_projection.hpp"

namespace fathom::surface {

// Nodes of a chart's lattice, relative to the projections' origin.
struct NodePoints {
  int count = 0;
  const float *x = nullptr, *y = nullptr, *z = nullptr;     // [m]
  const float *nx = nullptr, *ny = nullptr, *nz = nullptr;  // unit normals
};

// Their image positions in a view.
struct NodePixels {
  float *u = nullptr, *v = nullptr, *depth = nullptr;  // [px], [m]
  float* centrality = nullptr;                         // distance from the image's centre, 1 in the corners
  float* freedom = nullptr;  // 0: not visible; rises to 1 away from the border and from edge-on faces
};

// A view over one cell: image position and weight in its corners (left top, right top, left bottom,
// right bottom).
struct CellView {
  std::uint32_t place = 0;  // of the view in its index
  const std::uint8_t* pixels = nullptr;
  std::ptrdiff_t stride = 0;       // bytes from row to row
  float limit_u = 0, limit_v = 0;  // positions are cut to 0 .. limit [px]
  std::array<float, 4> u{}, v{}, weight{};
};

// The texels of a cell within its chart.
struct CellTexels {
  std::uint8_t* out = nullptr;
  std::ptrdiff_t stride = 0;  // bytes from row to row
  int columns = 0, rows = 0;
};

// The inner loops, once per instruction set: the same operations in the same order without fused
// multiply-add, so that every set gives the same bits.
struct BlendKernels {
  // `fade`: width of the rise at the image's border [px].
  void (*projectNodes)(const ViewProjection& view, const NodePoints& nodes, float fade,
                       const NodePixels& out);
  // out = freedom exp(-k centrality).
  void (*weigh)(const float* centrality, const float* freedom, int count, float k, float* out);
  // Over `views` rows of `count` weights, a column at a time: takes kLeast of the largest off each, cuts at 0
  // and divides by the sum. A column of zeros stays. `sums`: room for 2 count.
  void (*normalise)(float* weights, int views, int count, std::ptrdiff_t row, float* sums);
  // colour += (low - middle) coarse + middle fine; fine_of_high += high fine: four values a node.
  void (*gatherBands)(const LowPass& fine, const LowPass& coarse, const float* u, const float* v,
                      const float* low, const float* middle, const float* high, int count, float* colour,
                      float* fine_of_high);
  // texel = base + sum of weight * image, all interpolated between the corners. `base`: four values a corner.
  void (*blendCell)(const CellView* views, int count, const float* base, const CellTexels& texels);
  // texel = image of the view of largest weight; `chosen`: which, row by row, kStep a row.
  void (*bestCell)(const CellView* views, int count, const CellTexels& texels, std::uint32_t* chosen);
};

constexpr float kLeastWeight = 0.02F;  // of the largest: below this a view is left out

FATHOM_INSTRUCTION_SETS(const BlendKernels&, BlendKernels);

}  // namespace fathom::surface
