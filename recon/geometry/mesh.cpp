#include "recon/geometry/mesh.hpp"

#include <Eigen/Geometry>

namespace fathom {

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

}  // namespace fathom
