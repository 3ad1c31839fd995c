#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "recon/compare/plane_frame.hpp"
#include "recon/products/tiles/model_file.hpp"

namespace fathom::topside {

// The vertices of a level as a point cloud: LAS 1.4 (ASPRS, R15), point format 7: x, y in the coordinate
// reference system `crs` ("EPSG:32755"; written as WKT), z up from the water's surface, in millimetres; red,
// green, blue of 16 bits as writeModelPly's. `own`: the system of the tiles; no `crs`: that, as a local
// one. Class 1 (unclassified), one return each, no times. Throws
// InputError for a system that is not in metres, and for a place that is outside of it.
ModelCounts writeModelLas(const std::filesystem::path& path, std::vector<TileId> tiles,
                          const TileSource& source, const compare::PlaneFrame& own, const std::string& crs);

}  // namespace fathom::topside
