#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::telemetry {

// Whole meshes through Draco (edgebreaker, its slowest and smallest setting): for fast links, for models kept
// on the ship, and as the peer that the map packets are measured against. Best effort: it allocates.
struct DracoMeshConfig {
  double max_error = 0.01;  // of each coordinate [m]; the bits of quantisation follow from the mesh's extent
  int position_bits = 0;    // 1 to 30: these instead
  int colour_bits = 8;      // of each channel, 1 to 8; 0 leaves colours out
  std::size_t max_vertices = 1U << 20;  // a larger mesh is refused
};

// Nullopt for a mesh that is empty, larger than max_vertices, not finite, or too wide for its max_error.
// Triangles keep their order of corners; vertices come out in another order, normals and the rest are
// dropped.
[[nodiscard]] std::optional<std::vector<std::uint8_t>> encodeDracoMesh(const Mesh& mesh,
                                                                       const DracoMeshConfig& config);

// Decodes bytes that may be anything; nullopt if they are not such a mesh. The counts of vertices and of
// triangles are read and bounded before Draco sees the bytes.
[[nodiscard]] std::optional<Mesh> decodeDracoMesh(std::span<const std::uint8_t> bytes,
                                                  std::size_t max_vertices = 1U << 20);

}  // namespace fathom::telemetry
