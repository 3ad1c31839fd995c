#pragma once

#include <filesystem>
#include <vector>

#include "recon/products/tiles/model_file.hpp"

namespace fathom::topside {

// A level of the model as one binary glTF 2.0 file with its textures inside. Each tile stays a mesh and a
// node of its own, byte for byte as it is in `folder`/L/x_y.glb: by KHR_draco_mesh_compression, unlit,
// atlas as JPEG (or WebP, by EXT_texture_webp). Axes as in the tiles: x east, y up, z south, of the dive's
// origin. Nothing but the tiles' JSON is in memory. Throws InputError for a tile that is none, and where the
// file would be larger than a GLB can be, 4 GiB.
ModelCounts writeModelGlb(const std::filesystem::path& path, const std::filesystem::path& folder,
                          const std::vector<TileId>& tiles);

}  // namespace fathom::topside
