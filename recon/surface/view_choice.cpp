#include "recon/surface/view_choice.hpp"

#include <algorithm>

namespace fathom::surface {
namespace {

constexpr int kEvery = 16;  // nodes of the lattice

}  // namespace

std::vector<std::uint32_t> chooseViews(const ChartLattice& lattice, const std::vector<ViewProjection>& views,
                                       int most) {
  std::vector<std::uint8_t> chosen(views.size(), 0);
  std::vector<std::pair<float, std::uint32_t>> seeing;
  const auto look = [&](std::size_t node) {
    seeing.clear();
    for (std::uint32_t i = 0; i < views.size(); ++i) {
      const ViewProjection& view = views[i];
      const auto pixel = view.project(lattice.x[node], lattice.y[node], lattice.z[node]);
      if (!pixel.valid || pixel.u < 0 || pixel.v < 0 || pixel.u > view.width - 1 || pixel.v > view.height - 1)
        continue;
      const float x = 2 * pixel.u / (view.width - 1) - 1, y = 2 * pixel.v / (view.height - 1) - 1;
      seeing.emplace_back(x * x + y * y, i);
    }
    std::sort(seeing.begin(), seeing.end());
    for (std::size_t k = 0; k < std::min(seeing.size(), static_cast<std::size_t>(std::max(most, 0))); ++k)
      chosen[seeing[k].second] = 1;
  };
  for (const ChartLattice::Grid& grid : lattice.grids) {
    for (int j = 0; j < grid.rows; j += kEvery) {
      for (int i = 0; i < grid.columns; i += kEvery) {
        // The first node with a position of this square.
        [&] {
          for (int b = j; b < std::min(j + kEvery, grid.rows); ++b)
            for (int a = i; a < std::min(i + kEvery, grid.columns); ++a)
              if (lattice.known[grid.node(a, b)] != 0) return look(grid.node(a, b));
        }();
      }
    }
  }
  std::vector<std::uint32_t> out;
  for (std::uint32_t i = 0; i < views.size(); ++i)
    if (chosen[i] != 0) out.push_back(i);
  return out;
}

}  // namespace fathom::surface
