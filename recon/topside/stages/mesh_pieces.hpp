#pragma once

#include "recon/geometry/mesh.hpp"

namespace fathom::topside {

// Drops connected pieces smaller than `min_area` [m^2] and vertices that no triangle uses; returns the number
// of pieces dropped. The order of what stays is kept.
std::size_t dropSmallPieces(Mesh& mesh, double min_area);

}  // namespace fathom::topside
