#pragma once

#include <span>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/tile_mesh.hpp"
#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

// Meshes and tiles as bytes of work files, every number as it is. Loading returns false for bytes that are
// none, or with an index out of range.
[[nodiscard]] Bytes meshBytes(const Mesh& mesh);
[[nodiscard]] bool loadMesh(std::span<const std::uint8_t> bytes, Mesh& mesh);
[[nodiscard]] Bytes tileBytes(const TexturedTile& tile);
[[nodiscard]] bool loadTile(std::span<const std::uint8_t> bytes, TexturedTile& tile);

}  // namespace fathom::topside
