#include "tests/surface/synthetic_tiles.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>

#include "recon/fusion/marching_cubes.hpp"
#include "recon/surface/simplify.hpp"

namespace fathom::test {
namespace {

// Noise from a lattice of random values, smooth in between: the same at any place for every tile.
double smoothNoise(double north, double east, double step, unsigned seed) {
  const auto value = [&](double i, double j) {
    std::uint64_t h = seed * 0x9E3779B97F4A7C15ULL +
                      static_cast<std::uint64_t>(static_cast<std::int64_t>(i)) * 0xBF58476D1CE4E5B9ULL +
                      static_cast<std::uint64_t>(static_cast<std::int64_t>(j)) * 0x94D049BB133111EBULL;
    h = (h ^ (h >> 31)) * 0xD6E8FEB86659FD93ULL;
    h ^= h >> 32;
    return static_cast<double>(h % 2000001) / 1e6 - 1;
  };
  const double x = north / step, y = east / step;
  const double i = std::floor(x), j = std::floor(y);
  const auto ease = [](double t) { return t * t * (3 - 2 * t); };
  const double u = ease(x - i), v = ease(y - j);
  return (1 - u) * ((1 - v) * value(i, j) + v * value(i, j + 1)) +
         u * ((1 - v) * value(i + 1, j) + v * value(i + 1, j + 1));
}

double terrainDepth(double north, double east, double noise, unsigned seed) {
  return 2.0 + 0.1 * std::sin(1.7 * north) + 0.08 * std::cos(2.3 * east) +
         noise * smoothNoise(north, east, 0.1, seed) + 3 * noise * smoothNoise(north, east, 0.6, seed + 1);
}

}  // namespace

Ground noisyTerrain(double noise, unsigned seed) {
  return [=](double north, double east, double depth) {
    return 0.9 * (terrainDepth(north, east, noise, seed) - depth);
  };
}

Ground difficultTerrain(unsigned seed) {
  return [=](double north, double east, double depth) {
    if (std::hypot(north - 1.5, east - 0.6) < 0.25) return std::numeric_limits<double>::quiet_NaN();
    const double floor = 0.9 * (terrainDepth(north, east, 0.006, seed) - depth);
    const auto sphere = [&](double n, double e, double d, double r) {
      return std::sqrt((north - n) * (north - n) + (east - e) * (east - e) + (depth - d) * (depth - d)) - r;
    };
    const double boulder = sphere(0.6, 0.6, 1.75, 0.32);
    const double wall = std::max({std::abs(east - 1.55) - 0.04, std::abs(north - 1.2) - 0.7, 1.4 - depth});
    const double ring = std::hypot(north - 0.7, depth - 1.95) - 0.35;
    const double arch = std::hypot(ring, east - 2.1) - 0.09;
    const double pebble = sphere(1.7, 1.1, 1.2, 0.06);
    return std::min({floor, boulder, wall, arch, pebble}) +
           0.004 * smoothNoise(north + depth, east - depth, 0.09, seed);
  };
}

TileMesh syntheticTile(const Ground& ground, const TileGrid& grid, const TileId& tile, double top,
                       double bottom) {
  static const fusion::MarchingCubesTable table;
  const int n = grid.leaf_voxels + 1;
  const int base = static_cast<int>(std::floor(top / grid.voxel));
  const int layers = static_cast<int>(std::ceil((bottom - top) / grid.voxel)) + 1;
  const auto place = [&](int i, int j, int k) {
    return Eigen::Vector3d((tile.x * grid.leaf_voxels + i) * grid.voxel,
                           (tile.y * grid.leaf_voxels + j) * grid.voxel, (base + k) * grid.voxel);
  };
  const auto number = [&](int i, int j, int k) { return static_cast<std::size_t>((k * n + j) * n + i); };
  std::vector<double> distance(static_cast<std::size_t>(n * n * layers));
  for (int k = 0; k < layers; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const Eigen::Vector3d p = place(i, j, k);
        distance[number(i, j, k)] = ground(p.x(), p.y(), p.z());
      }
  TileMesh out;
  out.tile = tile;
  std::map<std::pair<std::size_t, int>, std::uint32_t> vertices;
  for (int k = 0; k + 1 < layers; ++k)
    for (int j = 0; j + 1 < n; ++j)
      for (int i = 0; i + 1 < n; ++i) {
        unsigned signs = 0;
        bool known = true;
        for (int c = 0; c < 8; ++c) {
          const double d = distance[number(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1))];
          known = known && !std::isnan(d);
          if (d < 0) signs |= 1U << c;
        }
        if (!known) continue;
        const auto& pattern = table.pattern(signs);
        for (std::size_t t = 0; t < pattern.triangles; ++t) {
          std::array<std::uint32_t, 3> triangle;
          for (std::size_t m = 0; m < 3; ++m) {
            const auto& edge = table.edge(pattern.edge[t][m]);
            const int a = i + (edge.from & 1), b = j + (edge.from >> 1 & 1), c = k + (edge.from >> 2 & 1);
            const auto [found, fresh] = vertices.try_emplace(
                {number(a, b, c), edge.axis}, static_cast<std::uint32_t>(out.mesh.vertices.size()));
            triangle[m] = found->second;
            if (!fresh) continue;
            const double from = distance[number(a, b, c)];
            const double to =
                distance[number(a + (edge.axis == 0), b + (edge.axis == 1), c + (edge.axis == 2))];
            Eigen::Vector3d p = place(a, b, c);
            p[edge.axis] += grid.voxel * std::clamp(from / (from - to), 0.05, 0.95);
            for (int x = 0; x < 3; ++x) p[x] = TileGrid::snap(p[x]);
            out.mesh.vertices.push_back(p.cast<float>());
            const bool on_north = edge.axis != 0 && (a == 0 || a == n - 1);
            const bool on_east = edge.axis != 1 && (b == 0 || b == n - 1);
            out.shared.push_back(on_north || on_east ? surface::sidesOf(out.mesh.vertices.back(), grid, tile)
                                                     : 0);
            out.mesh.sigma.push_back(0.004F);
            out.mesh.colours.push_back({static_cast<std::uint8_t>(40 + (a * 3) % 200), 120, 90});
            out.views.push_back(5);
          }
          out.mesh.triangles.push_back(triangle);
        }
      }
  computeNormals(out.mesh);
  return out;
}

}  // namespace fathom::test
