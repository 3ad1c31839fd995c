#pragma once

#include <cstdint>
#include <vector>

#include "recon/surface/chart_lattice.hpp"
#include "recon/surface/view_projection.hpp"

namespace fathom::surface {

// Which of the views are worth their images: those that are among the `most` most central ones at some place
// of the surface (sampled every 16 cm at 1.2 mm a texel). It bounds the work and the images held where the
// vehicle stood still or passed many times. Places in `views`, ascending.
[[nodiscard]] std::vector<std::uint32_t> chooseViews(const ChartLattice& lattice,
                                                     const std::vector<ViewProjection>& views, int most);

}  // namespace fathom::surface
