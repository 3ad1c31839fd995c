#include "recon/geometry/mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace fathom {
namespace {

// Magic, version, triangular mesh, edgebreaker, no flags; then follow a byte for the coding of edgebreaker's
// symbols, the number of vertices and that of faces.
constexpr std::array<std::uint8_t, 11> kHead{'D', 'R', 'A', 'C', 'O', 2, 2, 1, 1, 0, 0};

// LEB128, at most 32 bits; moves `at`.
std::optional<std::uint32_t> readVarint(std::span<const std::uint8_t> bytes, std::size_t& at) {
  std::uint64_t value = 0;
  for (unsigned shift = 0; shift < 35 && at < bytes.size(); shift += 7) {
    const std::uint8_t byte = bytes[at++];
    value |= std::uint64_t{byte & 0x7FU} << shift;
    if ((byte & 0x80U) == 0)
      return value <= 0xFFFFFFFFU ? std::optional(static_cast<std::uint32_t>(value)) : std::nullopt;
  }
  return std::nullopt;
}

}  // namespace

void computeNormals(Mesh& mesh) {
  mesh.normals.assign(mesh.vertices.size(), Eigen::Vector3f::Zero());
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3f n =
        (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]);
    for (const std::uint32_t v : {a, b, c}) mesh.normals[v] += n;
  }
  for (Eigen::Vector3f& n : mesh.normals) n.normalize();
}

void transform(Mesh& mesh, const SE3& T_new_old) {
  const Eigen::Matrix3f r = T_new_old.matrix3().cast<float>();
  for (Eigen::Vector3f& v : mesh.vertices) v = (T_new_old * v.cast<double>()).cast<float>();
  for (Eigen::Vector3f& n : mesh.normals) n = r * n;
}

std::optional<DracoCounts> dracoCounts(std::span<const std::uint8_t> bytes) {
  if (bytes.size() < kHead.size() + 1 || !std::equal(kHead.begin(), kHead.end(), bytes.begin()))
    return std::nullopt;
  std::size_t at = kHead.size() + 1;
  const auto vertices = readVarint(bytes, at);
  const auto faces = readVarint(bytes, at);
  if (!vertices || !faces) return std::nullopt;
  return DracoCounts{*vertices, *faces};
}

}  // namespace fathom
