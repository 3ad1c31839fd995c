#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "recon/geometry/colour.hpp"
#include "recon/geometry/tile_mesh.hpp"
#include "recon/products/tiles/draco_surface.hpp"
#include "recon/products/tiles/picture_codec.hpp"

namespace fathom::topside {

// nav (north, east, down) to glTF (east, up, south) and back.
[[nodiscard]] inline Eigen::Vector3d gltfFromNav(const Eigen::Vector3d& v) {
  return {v.y(), -v.z(), -v.x()};
}
[[nodiscard]] inline Eigen::Vector3d navFromGltf(const Eigen::Vector3d& v) {
  return {-v.z(), v.x(), -v.y()};
}
[[nodiscard]] inline Eigen::Vector3f gltfFromNav(const Eigen::Vector3f& v) {
  return {v.y(), -v.z(), -v.x()};
}
[[nodiscard]] inline Eigen::Vector3f navFromGltf(const Eigen::Vector3f& v) {
  return {-v.z(), v.x(), -v.y()};
}

// sRGB's transfer function (IEC 61966-2-1); glTF wants colours of vertices linear. 16 bits tell all 256
// values of sRGB apart.
[[nodiscard]] inline std::uint16_t linear16Of(std::uint8_t srgb) {
  return static_cast<std::uint16_t>(std::lround(65535 * linearFromSrgb(srgb)));
}
[[nodiscard]] inline std::uint8_t srgb8Of(std::uint16_t linear) {
  const double srgb = srgbFromLinear(linear / 65535.0);
  return static_cast<std::uint8_t>(std::clamp(std::lround(255 * srgb), 0L, 255L));
}

// Words of a GLB's header and of its chunks' (glTF 2.0, section 4.4).
inline constexpr std::uint32_t kGlbMagic = 0x46546C67, kGlbVersion = 2, kJsonChunk = 0x4E4F534A,
                               kBinaryChunk = 0x004E4942;

struct GlbConfig {
  PictureConfig picture;    // kNone: texture coordinates without a picture, for one that is beside
  DracoConfig draco;        // texture_edge is set from the atlas
  bool sigma = true;        // attribute _SIGMA [m]
  bool views = true;        // attribute _VIEWS, a whole number
  std::string gpu_texture;  // name of a KTX2 or DDS file beside the tile, named in the material's extras
};

struct GlbFacts {
  std::size_t surface_bytes = 0, picture_bytes = 0, total_bytes = 0;
};

// A tile as glTF 2.0 in one binary file, the content of a 3D tile: one mesh by KHR_draco_mesh_compression,
// its atlas as JPEG or WebP (EXT_texture_webp), unlit (KHR_materials_unlit: light is already taken out).
// Axes: x east, y up, z south, of nav's origin. Positions are whole numbers; the node's scale is the step,
// TileGrid::kLattice (twice, four times... it for a tile of more than 8 km), and its translation (double, on
// the lattice) the tile's own origin: what comes out is exact. Without an atlas the colours
// stand at the vertices (COLOR_0, linear, 16 bits). The node's extras say which tile it is:
//   {"tile": [level, x, y], "voxel": m, "leaf_voxels": n, "error": m, "texel": m}
// The same tile and settings give the same bytes. Throws std::invalid_argument for a tile without triangles,
// with a vertex off the lattice or with an atlas and no texture coordinates.
[[nodiscard]] std::vector<std::uint8_t> writeGlb(const TexturedTile& tile, const TileGrid& grid,
                                                 const GlbConfig& config, GlbFacts* facts = nullptr);

// A GLB as writeGlb makes it, back in nav. Positions are equal to the last bit; `shared` is found from the
// borders' planes; vertices and triangles come in another order; normals are within 0.2 degrees, texture
// coordinates within 1/8 texel, sigma within 0.13 mm. Bytes that are anything else give InputError naming
// `name`.
struct ReadTile {
  TexturedTile tile;
  TileGrid grid;
  std::vector<std::uint8_t> picture;  // the file of the atlas as it was stored; empty without
  std::string gpu_texture;            // name of a file beside the tile; empty without
};
enum class ReadPicture : std::uint8_t { kDecode, kKeepFile, kSkip };
[[nodiscard]] ReadTile readGlb(std::span<const std::uint8_t> bytes, const std::string& name,
                               ReadPicture picture = ReadPicture::kDecode);

}  // namespace fathom::topside
