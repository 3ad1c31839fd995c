// OpenMesh's headers are not clean under -Wshadow and the like: they come in as system headers.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wnon-virtual-dtor"
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModNormalFlippingT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>
#pragma GCC diagnostic pop

#include "telemetry/monitor/codec/peers/lattice.hpp"

namespace fathom::peers {
namespace {
using OpenMeshMesh = OpenMesh::TriMesh_ArrayKernelT<>;
}

Mesh simplify(const Mesh& mesh, std::size_t vertices) {
  OpenMeshMesh work;
  std::vector<OpenMeshMesh::VertexHandle> handle;
  handle.reserve(mesh.vertices.size());
  Eigen::Vector3f least = mesh.vertices.front(), greatest = least;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    handle.push_back(work.add_vertex({v.x(), v.y(), v.z()}));
    least = least.cwiseMin(v);
    greatest = greatest.cwiseMax(v);
  }
  for (const auto& t : mesh.triangles) work.add_face(handle[t[0]], handle[t[1]], handle[t[2]]);
  // The rectangle's corners stay.
  work.request_vertex_status();
  work.request_edge_status();
  work.request_face_status();
  work.request_face_normals();
  work.update_face_normals();
  for (std::size_t k = 0; k < mesh.vertices.size(); ++k) {
    const Eigen::Vector3f& v = mesh.vertices[k];
    if ((v.x() == least.x() || v.x() == greatest.x()) && (v.y() == least.y() || v.y() == greatest.y()))
      work.status(handle[k]).set_locked(true);
  }
  OpenMesh::Decimater::DecimaterT<OpenMeshMesh> decimater(work);
  OpenMesh::Decimater::ModQuadricT<OpenMeshMesh>::Handle quadric;
  decimater.add(quadric);
  OpenMesh::Decimater::ModNormalFlippingT<OpenMeshMesh>::Handle flipping;  // no triangle turns over
  decimater.add(flipping);
  decimater.module(flipping).set_max_normal_deviation(60);  // [deg]
  decimater.initialize();
  decimater.decimate_to(vertices);
  work.garbage_collection();
  Mesh out;
  for (const auto v : work.vertices()) {
    const auto& p = work.point(v);
    out.vertices.emplace_back(p[0], p[1], p[2]);
  }
  for (const auto f : work.faces()) {
    std::array<std::uint32_t, 3> triangle{};
    std::size_t c = 0;
    for (auto v = work.cfv_ccwbegin(f); v != work.cfv_ccwend(f) && c < 3; ++v, ++c)
      triangle[c] = static_cast<std::uint32_t>(v->idx());
    out.triangles.push_back(triangle);
  }
  return out;
}

}  // namespace fathom::peers
