#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "telemetry/map/map_packet.hpp"

namespace fathom::monitor {

// A surface on a lattice of nodes through nav's origin: node (i, j) stands at north = (north0 + i) * cell,
// east = (east0 + j) * cell.
struct LatticeSurface {
  double cell = 0;  // [m]
  std::int32_t north0 = 0, east0 = 0;
  int rows = 0, cols = 0;
  std::vector<float> depth;  // nav z [m], row by row; NaN where the surface has a hole
  std::vector<Rgb> colour;   // the same; empty without colour
  std::size_t seen = 0;      // nodes that are not holes

  [[nodiscard]] std::size_t at(int i, int j) const {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(cols) + static_cast<std::size_t>(j);
  }
  // Area of the seen nodes, a cell each [m2].
  [[nodiscard]] double area() const { return static_cast<double>(seen) * cell * cell; }
};

// kMap: as the onboard map at that spacing, the mean of a finer lattice under a tent one cell wide
// (recon/fusion, QuadtreeMap::extract), for nodes with half of the tent or more seen. kPoint: the surface at
// the node alone.
enum class Sampling : std::uint8_t { kMap, kPoint };

// Samples a mesh (x north, y east, z down) at the nodes: the topmost surface where there are several. Throws
// InputError naming `path`: no triangle over any node, more than kMaxNodes nodes, cell not a spacing that a
// map block can have.
inline constexpr std::size_t kMaxNodes = 64'000'000;
[[nodiscard]] LatticeSurface sampleSurface(const Mesh& mesh, double cell, Sampling sampling,
                                           const std::filesystem::path& path);

// Some of the surface's nodes as map blocks, rows and columns counted from the surface's first.
[[nodiscard]] std::vector<telemetry::MapBlock> cutBlocks(const LatticeSurface& surface, int row, int col,
                                                         int rows, int cols);
// All of them, blocks with nothing seen left out, along a curve that keeps neighbours together.
[[nodiscard]] std::vector<telemetry::MapBlock> cutBlocks(const LatticeSurface& surface);

}  // namespace fathom::monitor
