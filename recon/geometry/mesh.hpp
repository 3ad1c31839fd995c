#pragma once

#include <Eigen/Core>
#include <array>
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

}  // namespace fathom
