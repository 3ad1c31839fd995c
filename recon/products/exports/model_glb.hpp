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

// A level of the model as one binary glTF 2.0 file with its textures inside. Each tile stays a mesh and a
// node of its own, byte for byte as it is in `folder`/L/x_y.glb: by KHR_draco_mesh_compression, unlit,
// atlas as JPEG (or WebP, by EXT_texture_webp). Axes as in the tiles: x east, y up, z south, of the dive's
// origin. Nothing but the tiles' JSON is in memory. Throws InputError for a tile that is none, and where the
// file would be larger than a GLB can be, 4 GiB.
ModelCounts writeModelGlb(const std::filesystem::path& path, const std::filesystem::path& folder,
                          const std::vector<TileId>& tiles);

}  // namespace fathom::topside
