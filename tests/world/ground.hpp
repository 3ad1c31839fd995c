#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <random>

#include "recon/compare/plane_frame.hpp"
#include "recon/geometry/mesh.hpp"
#include "tests/support/lattice_mesh.hpp"

namespace fathom::test {

// A synthetic range mesh like sparse stereo's: points on a jittered grid over a height field z(north, east),
// seen from above, with Gaussian noise along z.
struct Footprint {
  double north = 0, east = 0;    // centre [m]
  double length = 2, width = 2;  // [m]
  double spacing = 0.06;         // between points [m]
  double sigma = 0.01;           // of the noise [m]; the mesh states it
  Rgb colour = {90, 120, 60};
};

inline Mesh rangeMesh(const Footprint& f, const std::function<double(double, double)>& depth, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, 1.0);
  std::uniform_real_distribution<double> jitter(-0.3, 0.3);
  const int rows = std::max(2, static_cast<int>(f.length / f.spacing) + 1);
  const int columns = std::max(2, static_cast<int>(f.width / f.spacing) + 1);
  Mesh mesh;
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) {
      const bool inside = i > 0 && i < rows - 1 && j > 0 && j < columns - 1;
      const double n =
          f.north - f.length / 2 + f.length * i / (rows - 1) + (inside ? jitter(random) * f.spacing : 0);
      const double e =
          f.east - f.width / 2 + f.width * j / (columns - 1) + (inside ? jitter(random) * f.spacing : 0);
      mesh.vertices.emplace_back(n, e, depth(n, e) + f.sigma * noise(random));
      mesh.sigma.push_back(static_cast<float>(f.sigma));
      mesh.colours.push_back(f.colour);
    }
  }
  mesh.triangles = latticeTriangles(rows, columns);
  return mesh;
}

// Of a mesh's faces [m2].
inline double areaOf(const Mesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    area +=
        0.5 * static_cast<double>(
                  (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm());
  return area;
}

// A level seafloor [m].
inline auto level(double depth) {
  return [depth](double, double) { return depth; };
}

// A rolling seafloor at 8 m with a step of 0.6 m: z at (north, east) [m].
inline double reef(double n, double e) {
  return 8.0 + 0.3 * std::sin(1.7 * n) + 0.25 * std::cos(1.3 * e) + (n + e > 3 ? -0.6 : 0.0);
}

// A bumpy seafloor of 8 x 6 m at 10 m depth.
inline Mesh syntheticSeafloor(double spacing = 0.05) {
  Mesh mesh;
  const int rows = static_cast<int>(std::lround(8.0 / spacing)),
            columns = static_cast<int>(std::lround(6.0 / spacing));
  for (int i = 0; i <= rows; ++i) {
    for (int j = 0; j <= columns; ++j) {
      const double n = -4.0 + i * spacing, e = -3.0 + j * spacing;
      const double z = 10.0 + 0.3 * std::sin(1.3 * n) * std::cos(1.1 * e + 0.4) + 0.1 * std::sin(3.0 * e - n);
      mesh.vertices.emplace_back(static_cast<float>(n), static_cast<float>(e), static_cast<float>(z));
    }
  }
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) {
      const auto at = [columns](int r, int c) { return static_cast<std::uint32_t>(r * (columns + 1) + c); };
      mesh.triangles.push_back({at(i, j), at(i, j + 1), at(i + 1, j)});
      mesh.triangles.push_back({at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)});
    }
  }
  return mesh;
}

// Hills and hollows of several sizes, the same everywhere [m].
inline double roughHeight(double east, double north) {
  return -14.0 + 0.30 * std::sin(0.9 * east + 0.4 * north) + 0.25 * std::cos(0.7 * north - 0.5 * east) +
         0.12 * std::sin(2.3 * east - 1.1 * north + 1.0) + 0.08 * std::cos(1.7 * east + 2.9 * north);
}

// Noise of standard deviation about 1 that is the same for the same place and seed.
inline double noiseAt(int column, int row, std::uint64_t seed) {
  std::uint64_t h = seed * 0x9E3779B97F4A7C15ULL +
                    static_cast<std::uint64_t>(column + 100000) * 0xBF58476D1CE4E5B9ULL +
                    static_cast<std::uint64_t>(row + 100000) * 0x94D049BB133111EBULL;
  double sum = 0;
  for (int i = 0; i < 4; ++i) {
    h ^= h >> 31;
    h *= 0xD6E8FEB86659FD93ULL;
    h ^= h >> 29;
    sum += static_cast<double>(h >> 11) * 0x1.0p-53 - 0.5;
  }
  return sum * std::sqrt(3.0);
}

// Height(east, north) in the cells of a box, with noise [m].
template <typename Height>
compare::HeightMap mapOf(const compare::Box& box, double cell, const Height& height, double noise,
                         std::uint64_t seed) {
  compare::HeightMap map(box, cell);
  for (int row = 0; row < map.rows; ++row)
    for (int column = 0; column < map.columns; ++column)
      map.up[map.index(column, row)] = static_cast<float>(height(map.eastOf(column), map.northOf(row)) +
                                                          noise * noiseAt(column, row, seed));
  return map;
}

}  // namespace fathom::test
