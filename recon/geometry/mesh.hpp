#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "recon/geometry/se3.hpp"

namespace fathom {

using Rgb = std::array<std::uint8_t, 3>;
inline constexpr Rgb kUncolouredRgb = {128, 128, 128};  // of surfaces without colours

// Indexed triangle mesh. Attribute vectors are empty or as long as `vertices`. Triangles are
// counter-clockwise seen from the side that the surface normal points to (for a seafloor in nav: upwards,
// negative z).
struct Mesh {
  std::vector<Eigen::Vector3f> vertices;             // [m]
  std::vector<Eigen::Vector3f> normals;              // unit length
  std::vector<Rgb> colours;                          // sRGB
  std::vector<Eigen::Vector2f> texture_coordinates;  // (s, t), t upwards: row = (1 - t) * image height
  std::vector<float> sigma;                          // standard deviation along the normal or the ray [m]
  std::vector<std::array<std::uint32_t, 3>> triangles;

  [[nodiscard]] bool empty() const { return triangles.empty(); }
};

// Area-weighted vertex normals from the triangles.
void computeNormals(Mesh& mesh);
// Applies T_new_old to vertices and normals.
void transform(Mesh& mesh, const SE3& T_new_old);

struct DracoCounts {
  std::uint32_t vertices = 0, faces = 0;
};

// The numbers that the head of a stream of Draco's bitstream 2.2 states, of a triangular mesh by edgebreaker
// without flags; std::nullopt for any other bytes. Draco takes memory for these counts before it looks at the
// rest: a reader of bytes from outside bounds them first.
[[nodiscard]] std::optional<DracoCounts> dracoCounts(std::span<const std::uint8_t> bytes);

// A side of a triangle is named by the corner at its start, 3 * triangle + k; it ends at the next one.
[[nodiscard]] constexpr std::uint32_t nextCorner(std::uint32_t corner) {
  return corner % 3 == 2 ? corner - 2 : corner + 1;
}

// Calls visit(sides) for every edge of the triangles with all sides along it, ascending (in a
// std::vector<std::uint32_t>): one on a border, two inside, more where sheets meet. Edges are visited by
// their lower vertex, then the higher.
void visitEdges(std::span<const std::array<std::uint32_t, 3>> triangles, auto&& visit) {
  struct Side {
    std::uint64_t edge;
    std::uint32_t corner;
    auto operator<=>(const Side&) const = default;
  };
  std::vector<Side> sides;
  sides.reserve(3 * triangles.size());
  for (const auto& t : triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t a = t[k], b = t[(k + 1) % 3];
      sides.push_back({std::min(a, b) << 32 | std::max(a, b), static_cast<std::uint32_t>(sides.size())});
    }
  std::sort(sides.begin(), sides.end());
  std::vector<std::uint32_t> corners;
  for (std::size_t first = 0, last = 0; first < sides.size(); first = last) {
    corners.clear();
    while (last < sides.size() && sides[last].edge == sides[first].edge)
      corners.push_back(sides[last++].corner);
    visit(corners);
  }
}

// Calls visit(row, column, shares) for every cell of a grid with its middle in a triangle or on its border;
// `p` in cells (row, column), a cell's middle at its whole number; the shares are the corners'.
void scanTriangle(const std::array<Eigen::Vector2d, 3>& p, int rows, int columns, auto&& visit) {
  constexpr double kOnBorder = -1e-9;  // a share so small is rounding
  const Eigen::Vector2d ab = p[1] - p[0], ac = p[2] - p[0];
  const double area2 = ab.x() * ac.y() - ab.y() * ac.x();
  if (!(std::abs(area2) > 1e-12)) return;  // edge-on
  const auto [low_x, high_x] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
  const auto [low_y, high_y] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
  // Bounded first: a corner may be anywhere.
  const auto first = [](double low, int end) {
    return static_cast<int>(std::clamp(std::ceil(low - 1e-6), 0.0, static_cast<double>(end)));
  };
  const auto last = [](double high, int end) {
    return static_cast<int>(std::clamp(std::floor(high + 1e-6), -1.0, end - 1.0));
  };
  const int x0 = first(low_x, rows), x1 = last(high_x, rows);
  const int y0 = first(low_y, columns), y1 = last(high_y, columns);
  // Shares are linear in row and column.
  const double w1_x = ac.y() / area2, w1_y = -ac.x() / area2;
  const double w2_x = -ab.y() / area2, w2_y = ab.x() / area2;
  for (int x = x0; x <= x1; ++x) {
    const double w1_row = (x - p[0].x()) * w1_x - p[0].y() * w1_y;
    const double w2_row = (x - p[0].x()) * w2_x - p[0].y() * w2_y;
    for (int y = y0; y <= y1; ++y) {
      const double w1 = w1_row + y * w1_y, w2 = w2_row + y * w2_y, w0 = 1 - w1 - w2;
      if (w0 < kOnBorder || w1 < kOnBorder || w2 < kOnBorder) continue;
      visit(x, y, std::array<double, 3>{w0, w1, w2});
    }
  }
}

}  // namespace fathom
