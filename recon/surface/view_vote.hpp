#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/surface/band_image.hpp"
#include "recon/surface/chart_lattice.hpp"
#include "recon/surface/view_projection.hpp"

namespace fathom::surface {

// Surfaces that may hide others, in single precision relative to an origin near them, in patches that a view
// can skip as a whole.
struct Occluders {
  struct Patch {
    Eigen::Vector3f middle = Eigen::Vector3f::Zero();
    float radius = 0;
    std::uint32_t first_vertex = 0, vertices = 0, first_triangle = 0, triangles = 0;
  };
  Occluders() = default;
  Occluders(const std::vector<const Mesh*>& meshes, const Eigen::Vector3d& origin);

  std::vector<Patch> patches;
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;  // of vertices counted from their patch's first
};

// Depth buffer of one view in cells of kCell x kCell pixels: the inverse depth of the nearest face within
// one cell of a cell's centre, reduced by the face's slope over that distance, so that a slope does not
// hide itself.
class DepthBuffer {
 public:
  static constexpr int kCell = 8;  // [px]

  void draw(const Occluders& occluders, const ViewProjection& view);
  // Visibility of a point: 1 without a surface more than `tolerance` [m] before it, falling to 0 over half a
  // cell outside the edge of an occluder, and 0 within a cell of that edge.
  [[nodiscard]] float visibility(float u, float v, float depth, float tolerance) const;

 private:
  struct Vertex {
    float x, y, inverse;  // [cells], [1/m]; inverse 0: not projected
  };
  void drawTriangle(const Vertex& a, const Vertex& b, const Vertex& c);

  int width_ = 0, height_ = 0;  // [cells]
  std::vector<float> nearest_;  // [1/m]; 0: nothing
  std::vector<Vertex> projected_;
};

// A view of the tile that is being textured.
struct ActiveView {
  std::uint32_t place = 0;  // in the index
  ViewProjection projection;
  DepthBuffer depth;
  std::shared_ptr<const BandImage> bands;
  float fade = 0;  // over which its weight rises from the image's border and hidden parts [px]
};

// Rejects views at places where they show something that is not on the surface: a fish, the vehicle's shadow.
// At every kStep-th node of the lattice that three or more views see, their low bands are compared, after
// each view's gain against the others is removed channel by channel (by medians over the tile, which a fish
// does not shift). A view is an outlier where the logarithm of its ratio to the median view exceeds kLimit
// and kSpread times the median difference of all; where all views differ (parallax, contrast at inaccurate
// poses) none is rejected. Around an outlier the view is rejected as far as it differs by more than kFringe,
// and one node more, as the low band spreads.
class ViewVote {
 public:
  static constexpr int kStep = 2;  // nodes of the lattice

  ViewVote(const ChartLattice& lattice, const std::vector<ActiveView>& views, float tolerance);

  // Weight of a view, 0 to 1, at a chart's lattice nodes [i0, i1) of row j.
  void factors(std::size_t view, std::size_t chart, int j, int i0, int i1, float* out) const;
  [[nodiscard]] bool any() const { return outvoted_ > 0; }
  [[nodiscard]] std::uint64_t outvoted() const { return outvoted_; }  // pairs of a view and a node

 private:
  struct Grid {
    int columns = 0, rows = 0;
    std::size_t first = 0;
  };
  void sample(const ChartLattice& lattice, const std::vector<ActiveView>& views, float tolerance);
  void removeGains();
  void flagOutliers();
  void spread();

  std::size_t views_ = 0, nodes_ = 0;
  std::vector<Grid> grids_;  // one a chart
  // A view's nodes one after another: logarithm of its low band (r, g, b), whether it sees the node.
  std::vector<float> colour_;
  std::vector<std::uint8_t> seen_, outlier_;
  std::vector<float> difference_;  // from the median view
  std::uint64_t outvoted_ = 0;
};

}  // namespace fathom::surface
