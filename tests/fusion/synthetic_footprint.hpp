#pragma once

#include <cmath>
#include <functional>
#include <random>

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

// A rolling seafloor at 8 m with a step of 0.6 m: z at (north, east) [m].
inline double reef(double n, double e) {
  return 8.0 + 0.3 * std::sin(1.7 * n) + 0.25 * std::cos(1.3 * e) + (n + e > 3 ? -0.6 : 0.0);
}

}  // namespace fathom::test
