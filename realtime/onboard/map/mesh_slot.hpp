#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "recon/geometry/mesh.hpp"

namespace fathom::onboard {

// A local mesh as a block of bytes, without loss: u32 magic "FLM1", u16 vertices, u16 zero, u32 triangles;
// for each vertex x y z sigma (f32), for each triangle three u16, for each vertex three colour bytes. Little
// endian. Normals are not kept; a mesh has sigma and colours.
//
// meshSlotBytes(): size for a mesh of `max_points` points; a triangulation has fewer than twice as many
// triangles.

// Of a mesh of so many points: a triangulation has fewer than twice as many triangles.
[[nodiscard]] std::size_t meshSlotBytes(std::size_t max_points);
// Bytes used; 0 when the mesh does not fit.
[[nodiscard]] std::size_t writeMeshSlot(const Mesh& mesh, std::span<std::uint8_t> slot);
// False, leaving an empty mesh, for bytes that are no mesh.
[[nodiscard]] bool readMeshSlot(std::span<const std::uint8_t> slot, Mesh& mesh);

}  // namespace fathom::onboard
