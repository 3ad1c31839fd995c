#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "recon/surface/band_image.hpp"
#include "recon/surface/chart_lattice.hpp"
#include "recon/surface/depth_buffer.hpp"
#include "recon/surface/view_projection.hpp"

namespace fathom::surface {

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
  void takeGains();
  void judge();
  void spread();

  std::size_t views_ = 0, nodes_ = 0;
  std::vector<Grid> grids_;  // one a chart
  // A view's nodes one after another: logarithm of its low band (r, g, b), whether it sees the node.
  std::vector<float> colour_;
  std::vector<std::uint8_t> seen_, out_;
  std::vector<float> difference_;  // from the median view
  std::uint64_t outvoted_ = 0;
};

}  // namespace fathom::surface
