#pragma once

#include <array>
#include <cmath>
#include <map>

#include "recon/geometry/mesh.hpp"

namespace fathom::topside {

// Rms difference of two models' colours at vertices in the same squares of 2 cm [grey levels].
inline double colourDifference(const Mesh& a, const Mesh& b) {
  const auto square = [](const Eigen::Vector3f& p) {
    return std::array{static_cast<int>(std::floor(50 * p.x())), static_cast<int>(std::floor(50 * p.y()))};
  };
  std::map<std::array<int, 2>, std::size_t> by_square;
  for (std::size_t k = 0; k < a.vertices.size(); ++k) by_square[square(a.vertices[k])] = k;
  double squares = 0, count = 0;
  for (std::size_t k = 0; k < b.vertices.size(); ++k) {
    const auto same = by_square.find(square(b.vertices[k]));
    if (same == by_square.end()) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const double d = static_cast<double>(b.colours[k][c]) - a.colours[same->second][c];
      squares += d * d;
      count += 1;
    }
  }
  return std::sqrt(squares / count);
}

// Mean difference of a vertex's red, green and blue from their mean [grey levels].
inline double chromaOf(const Mesh& mesh) {
  double sum = 0;
  for (const Rgb& c : mesh.colours) {
    const double mean = (c[0] + c[1] + c[2]) / 3.0;
    sum += (std::abs(c[0] - mean) + std::abs(c[1] - mean) + std::abs(c[2] - mean)) / 3;
  }
  return sum / static_cast<double>(mesh.colours.size());
}

// Correlation of how much redder than blue two models are, by squares of 10 cm; 0 where one has no colours.
inline double hueCorrelation(const Mesh& a, const Mesh& b) {
  struct Sums {
    std::array<double, 2> redder{}, count{};
  };
  std::map<std::array<int, 2>, Sums> by_square;
  for (const std::size_t side : {0U, 1U}) {
    const Mesh& mesh = side == 0 ? a : b;
    for (std::size_t k = 0; k < mesh.vertices.size(); ++k) {
      const Eigen::Vector3f& p = mesh.vertices[k];
      Sums& sums =
          by_square[{static_cast<int>(std::floor(10 * p.x())), static_cast<int>(std::floor(10 * p.y()))}];
      sums.redder[side] += mesh.colours[k][0] - mesh.colours[k][2];
      sums.count[side] += 1;
    }
  }
  double n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
  for (const auto& [square, sums] : by_square) {
    constexpr double kEnough = 8;  // vertices
    if (sums.count[0] < kEnough || sums.count[1] < kEnough) continue;
    const double u = sums.redder[0] / sums.count[0], v = sums.redder[1] / sums.count[1];
    n += 1, x += u, y += v, xx += u * u, yy += v * v, xy += u * v;
  }
  const double spread = (xx - x * x / n) * (yy - y * y / n);
  return spread > 0 ? (xy - x * y / n) / std::sqrt(spread) : 0;
}

}  // namespace fathom::topside
