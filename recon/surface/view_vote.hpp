#pragma once

#include <cstdint>
#include <vector>

#include "recon/surface/active_view.hpp"
#include "recon/surface/chart_lattice.hpp"

namespace fathom::surface {

// Which views show something at a place that is not on the surface: a fish, the vehicle's own shadow. At
// every kStep-th node of the lattice that three or more views see, their low bands are compared. A view's
// overall gain against the others, a channel at a time, is taken off first (medians over the tile, so that a
// fish does not move it). A view is contradicted where its difference from the median view, as a logarithm,
// is larger than kLimit and than kSpread times the median difference of all: where all views differ from each
// other (parallax, a contrast that poses do not place alike) none is left out. Around a contradicted place
// the view is left out as far as it differs by more than kFringe, and one node more, because the low band
// spreads.
class ViewVote {
 public:
  static constexpr int kStep = 2;  // nodes of the lattice

  ViewVote(const ChartLattice& lattice, const std::vector<ActiveView>& views, float tolerance);

  // What remains of a view (1: all, 0: nothing) at a chart's lattice nodes [i0, i1) of row j.
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
