#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::topside {

struct DracoConfig {
  int normal_bits = 10;         // of each of two octahedral coordinates: within 0.2 degrees
  int texture_edge = 0;         // longer edge of the atlas [texels]; 0: no texture coordinates are written
  double sigma_step = 0.00025;  // [m]
  int speed = 3;                // Draco's, 0 smallest to 10 fastest
};

// A surface as Draco packs it for glTF (KHR_draco_mesh_compression): which attributes, by their unique ids,
// and what will come out of the decoder.
struct PackedSurface {
  std::vector<std::uint8_t> bytes;
  int position = -1, normal = -1, colour = -1, texture = -1, sigma = -1, views = -1;  // -1: not there
  std::size_t vertices = 0, triangles = 0;
};

// A surface in the axes and units of the file: positions in whole steps of TileGrid::kLattice (or of what the
// node's scale says) from the tile's origin, texture coordinates as glTF has them (v downwards), colours
// linear.
struct FileSurface {
  std::vector<Eigen::Vector3f> positions;             // whole numbers
  std::vector<Eigen::Vector3f> normals;               // empty or one a position, as all below
  std::vector<std::array<std::uint16_t, 3>> colours;  // linear, 65535 is white
  std::vector<Eigen::Vector2f> texture_coordinates;   // within [0, 1]
  std::vector<float> sigma;                           // [m]
  std::vector<std::uint16_t> views;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

// Positions are quantised in steps of exactly 1: a range of 2^bits - 1 makes Draco's own factor, range /
// (2^bits - 1), one, and its decoder's `whole number * factor + least` exact in single precision while a
// surface is less than 2^24 steps wide. (In metres it would not be: Draco hands the range to its encoder as
// text with six decimals.) Vertices are joined where all their attributes are equal and reordered; triangles
// with two equal corners are dropped. Throws std::invalid_argument for a surface without triangles, wider
// than that or with a position that is no whole number.
[[nodiscard]] PackedSurface packSurface(const FileSurface& surface, const DracoConfig& config);

// Which attribute ids a file names; -1: none.
struct SurfaceIds {
  int position = -1, normal = -1, colour = -1, texture = -1, sigma = -1, views = -1;
};
// Decodes bytes that may be anything; throws InputError naming `name`. Counts of vertices and triangles are
// bounded by the bytes' number before Draco sees them. Everything that is returned is finite and in range.
[[nodiscard]] FileSurface unpackSurface(std::span<const std::uint8_t> bytes, const SurfaceIds& ids,
                                        const std::string& name);

}  // namespace fathom::topside
