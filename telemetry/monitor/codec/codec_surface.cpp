#include "telemetry/monitor/codec/codec_surface.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "realtime/base/input_error.hpp"
#include "telemetry/vehicle/block_queue.hpp"

namespace fathom::monitor {
namespace {

using telemetry::floorDiv, telemetry::MapBlock;

// Twice the signed area of (a, b, p) in the plane.
double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
  return (b.x() - a.x()) * (p.y() - a.y()) - (b.y() - a.y()) * (p.x() - a.x());
}

// Sets the depth (and the nearest corner's colour) of the nodes under a triangle.
void drawTriangle(const Mesh& mesh, const std::array<std::uint32_t, 3>& corners, LatticeSurface& surface) {
  std::array<Eigen::Vector2d, 3> p;
  std::array<double, 3> z;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d v = mesh.vertices[corners[k]].cast<double>();
    p[k] = {v.x() / surface.cell - surface.north0, v.y() / surface.cell - surface.east0};
    z[k] = v.z();
  }
  const double area = cross(p[0], p[1], p[2]);
  if (!(std::abs(area) > 0)) return;
  const auto [i0, i1] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
  const auto [j0, j1] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
  for (int i = static_cast<int>(std::ceil(i0)); i <= static_cast<int>(std::floor(i1)); ++i) {
    for (int j = static_cast<int>(std::ceil(j0)); j <= static_cast<int>(std::floor(j1)); ++j) {
      const Eigen::Vector2d node(i, j);
      const std::array<double, 3> weight{cross(p[1], p[2], node) / area, cross(p[2], p[0], node) / area,
                                         cross(p[0], p[1], node) / area};
      if (*std::min_element(weight.begin(), weight.end()) < -1e-9) continue;
      const auto depth = static_cast<float>(weight[0] * z[0] + weight[1] * z[1] + weight[2] * z[2]);
      float& here = surface.depth[surface.at(i, j)];
      if (here <= depth) continue;  // false for a hole's NaN
      here = depth;
      if (surface.colour.empty()) continue;
      const auto nearest =
          static_cast<std::size_t>(std::max_element(weight.begin(), weight.end()) - weight.begin());
      surface.colour[surface.at(i, j)] = mesh.colours[corners[nearest]];
    }
  }
}

// Place of (x, y) along Hilbert's curve through a square of side 2^order (Warren, Hacker's Delight, 16-2).
std::uint64_t hilbertIndex(std::uint32_t x, std::uint32_t y, unsigned order) {
  std::uint64_t index = 0;
  for (std::uint32_t s = 1U << (order - 1); s > 0; s >>= 1) {
    const std::uint32_t rx = (x & s) != 0 ? 1 : 0, ry = (y & s) != 0 ? 1 : 0;
    index += std::uint64_t{s} * s * ((3 * rx) ^ ry);
    if (ry == 0) {
      if (rx == 1) {
        x = s - 1 - (x & (s - 1));
        y = s - 1 - (y & (s - 1));
      }
      std::swap(x, y);
    }
    x &= s - 1;
    y &= s - 1;
  }
  return index;
}

constexpr int kFiner = 5;               // nodes of the finer lattice in a cell, for means
constexpr double kLeastCoverage = 0.5;  // of the tent

LatticeSurface samplePoints(const Mesh& mesh, double cell, const std::filesystem::path& path) {
  if (mesh.triangles.empty())
    throw InputError(path.string(), "the mesh has no triangles", "give a surface, not a cloud of points");
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  double n0 = kInfinite, n1 = -kInfinite, e0 = kInfinite, e1 = -kInfinite;
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t k : triangle) {
      const Eigen::Vector3d v = mesh.vertices[k].cast<double>();
      n0 = std::min(n0, v.x());
      n1 = std::max(n1, v.x());
      e0 = std::min(e0, v.y());
      e1 = std::max(e1, v.y());
    }
  }
  n0 = std::ceil(n0 / cell);
  n1 = std::floor(n1 / cell);
  e0 = std::ceil(e0 / cell);
  e1 = std::floor(e1 / cell);
  constexpr double kFarthest = 1 << 28;  // nodes from the origin, what a block's key can say
  if (!(std::abs(n0) < kFarthest && std::abs(n1) < kFarthest && std::abs(e0) < kFarthest &&
        std::abs(e1) < kFarthest) ||
      (n1 - n0 + 1) * (e1 - e0 + 1) > static_cast<double>(kMaxNodes))
    throw InputError(path.string(), "the surface is too large for cells of " + std::to_string(cell) + " m",
                     "take larger cells with --cell");
  LatticeSurface surface;
  surface.cell = cell;
  surface.north0 = static_cast<std::int32_t>(n0);
  surface.east0 = static_cast<std::int32_t>(e0);
  surface.rows = static_cast<int>(std::max(0.0, n1 - n0 + 1));
  surface.cols = static_cast<int>(std::max(0.0, e1 - e0 + 1));
  const auto nodes = static_cast<std::size_t>(surface.rows) * static_cast<std::size_t>(surface.cols);
  surface.depth.assign(nodes, std::numeric_limits<float>::quiet_NaN());
  if (!mesh.colours.empty()) surface.colour.assign(nodes, Rgb{});
  for (const auto& triangle : mesh.triangles) drawTriangle(mesh, triangle, surface);
  return surface;
}

// The means of the finer lattice's nodes under a tent as wide as a cell on either side of each node.
LatticeSurface tentMeans(const LatticeSurface& fine, double cell) {
  LatticeSurface out;
  out.cell = cell;
  out.north0 = floorDiv(fine.north0, kFiner);
  out.east0 = floorDiv(fine.east0, kFiner);
  out.rows = floorDiv(fine.north0 + fine.rows - 1, kFiner) - out.north0 + 2;
  out.cols = floorDiv(fine.east0 + fine.cols - 1, kFiner) - out.east0 + 2;
  const auto nodes = static_cast<std::size_t>(out.rows) * static_cast<std::size_t>(out.cols);
  out.depth.assign(nodes, std::numeric_limits<float>::quiet_NaN());
  if (!fine.colour.empty()) out.colour.assign(nodes, Rgb{});
  for (int i = 0; i < out.rows; ++i) {
    for (int j = 0; j < out.cols; ++j) {
      double weight = 0, depth = 0;
      std::array<double, 3> colour{};
      for (int a = 1 - kFiner; a < kFiner; ++a) {
        for (int b = 1 - kFiner; b < kFiner; ++b) {
          const int r = (out.north0 + i) * kFiner + a - fine.north0,
                    c = (out.east0 + j) * kFiner + b - fine.east0;
          if (r < 0 || c < 0 || r >= fine.rows || c >= fine.cols || std::isnan(fine.depth[fine.at(r, c)]))
            continue;
          const double w = static_cast<double>((kFiner - std::abs(a)) * (kFiner - std::abs(b)));
          weight += w;
          depth += w * static_cast<double>(fine.depth[fine.at(r, c)]);
          for (std::size_t k = 0; k < 3 && !fine.colour.empty(); ++k)
            colour[k] += w * fine.colour[fine.at(r, c)][k];
        }
      }
      constexpr double kWholeTent = kFiner * kFiner * kFiner * kFiner;
      if (weight < kLeastCoverage * kWholeTent) continue;
      out.depth[out.at(i, j)] = static_cast<float>(depth / weight);
      for (std::size_t k = 0; k < 3 && !out.colour.empty(); ++k)
        out.colour[out.at(i, j)][k] = static_cast<std::uint8_t>(std::lround(colour[k] / weight));
    }
  }
  return out;
}

MapBlock emptyBlock(telemetry::SpacingCode spacing, int north, int east) {
  MapBlock block;
  block.key = {spacing, north, east};
  return block;
}

// Puts the surface's nodes into a block, those of the rows and columns given.
void fill(const LatticeSurface& surface, int row, int col, int rows, int cols, MapBlock& block) {
  for (int n = 0; n < MapBlock::kNodes; ++n) {
    const int i = block.key.north * MapBlock::kSide + n / MapBlock::kSide - surface.north0;
    const int j = block.key.east * MapBlock::kSide + n % MapBlock::kSide - surface.east0;
    if (i < row || j < col || i >= row + rows || j >= col + cols) continue;
    const float depth = surface.depth[surface.at(i, j)];
    if (std::isnan(depth)) continue;
    block.seen = static_cast<std::uint16_t>(block.seen | 1U << n);
    block.depth[static_cast<std::size_t>(n)] = depth;
    if (!surface.colour.empty()) block.colour[static_cast<std::size_t>(n)] = surface.colour[surface.at(i, j)];
  }
}

}  // namespace

LatticeSurface sampleSurface(const Mesh& mesh, double cell, Sampling sampling,
                             const std::filesystem::path& path) {
  if (!telemetry::spacingCode(cell))
    throw InputError(path.string(),
                     "--cell " + std::to_string(cell) + " is not a spacing that map blocks have",
                     "use a power of two metres or whole millimetres, 0.001 to 65.52 m");
  LatticeSurface surface = sampling == Sampling::kPoint
                               ? samplePoints(mesh, cell, path)
                               : tentMeans(samplePoints(mesh, cell / kFiner, path), cell);
  surface.seen = static_cast<std::size_t>(
      std::count_if(surface.depth.begin(), surface.depth.end(), [](float z) { return !std::isnan(z); }));
  if (surface.seen == 0)
    throw InputError(path.string(), "no node of the lattice is under the surface",
                     "take smaller cells with --cell");
  return surface;
}

std::vector<MapBlock> cutBlocks(const LatticeSurface& surface, int row, int col, int rows, int cols) {
  const telemetry::SpacingCode spacing = *telemetry::spacingCode(surface.cell);
  const int r0 = floorDiv(surface.north0 + row, MapBlock::kSide),
            c0 = floorDiv(surface.east0 + col, MapBlock::kSide);
  const int r1 = floorDiv(surface.north0 + row + rows - 1, MapBlock::kSide);
  const int c1 = floorDiv(surface.east0 + col + cols - 1, MapBlock::kSide);
  unsigned order = 1;
  while ((1 << order) <= std::max(r1 - r0, c1 - c0)) ++order;
  std::vector<std::pair<std::uint64_t, MapBlock>> keyed;
  for (int r = r0; r <= r1; ++r) {
    for (int c = c0; c <= c1; ++c) {
      MapBlock block = emptyBlock(spacing, r, c);
      fill(surface, row, col, rows, cols, block);
      if (block.seen == 0) continue;
      keyed.emplace_back(
          hilbertIndex(static_cast<std::uint32_t>(r - r0), static_cast<std::uint32_t>(c - c0), order), block);
    }
  }
  std::sort(keyed.begin(), keyed.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<MapBlock> blocks;
  blocks.reserve(keyed.size());
  for (const auto& [index, block] : keyed) blocks.push_back(block);
  return blocks;
}

std::vector<MapBlock> cutBlocks(const LatticeSurface& surface) {
  return cutBlocks(surface, 0, 0, surface.rows, surface.cols);
}

}  // namespace fathom::monitor
