#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <unordered_set>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "telemetry/monitor/map/block_store.hpp"

namespace fathom::monitor {

// The map at one place.
struct MapSurfacePoint {
  double depth = 0;                               // nav z [m]
  std::array<double, 3> colour{};                 // 0 to 255; valid with has_colour
  double sigma = 0, max_error = 0;                // of the block [m]
  std::int64_t received_utc_ns = 0;               // of the block
  std::int64_t changed_utc_ns = 0;                // 0: never
  telemetry::SpacingCode spacing = 0;             // of its lattice
  bool has_colour = false, interpolated = false;  // interpolated: no node was received at this place
};

// One chunk as triangles; normals up, corners counter-clockwise seen from above.
struct ChunkMesh {
  struct Vertex {
    std::uint16_t north = 0, east = 0;  // from the chunk's corner, 0 to kChunkUnits
    MapSurfacePoint point;
    std::array<float, 3> normal{};  // nav
  };
  std::vector<Vertex> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  double area = 0;            // in plan [m2]
  std::uint64_t version = 0;  // of the store when the mesh was built
};

// The surface of a BlockStore. Its cells are the finest for which nodes were received; when finer nodes cover
// only a part of a coarser cell, the rest of it is split into cells of their size with interpolated nodes.
// The height at a place depends on the place alone, and every cell includes the nodes of its finer neighbours
// on its edges, so that the mesh has no cracks between levels and chunks. Meshes are built when asked for and
// kept until the store changes there.
class Surface {
 public:
  explicit Surface(const BlockStore& store) : store_(store) {}

  // The mesh of a chunk that the store holds.
  const ChunkMesh& mesh(ChunkKey key);
  [[nodiscard]] double area();  // of all chunks, in plan [m2]
  // The whole map in nav, with colours (grey where none came) and sigma; chunk by chunk.
  [[nodiscard]] Mesh whole();
  // Between the nodes of the finest lattice that surrounds the place.
  [[nodiscard]] std::optional<MapSurfacePoint> sample(double north, double east) const;

 private:
  using Cells = std::unordered_set<std::uint32_t>;
  struct Cached {
    ChunkMesh mesh;
    Cells split;  // cells with finer ones inside
    std::uint64_t split_version = 0;
  };
  class Builder;
  friend class Builder;

  void refreshSplit(ChunkKey key);

  const BlockStore& store_;
  std::map<ChunkKey, Cached> cache_;
  std::uint64_t generation_ = 0;
};

}  // namespace fathom::monitor
