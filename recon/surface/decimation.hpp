#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <OpenMesh/Core/Mesh/TriConnectivity.hh>
#include <cstdint>
#include <vector>

#include "recon/geometry/tile_mesh.hpp"
#include "recon/surface/simplify.hpp"

namespace fathom::surface {

// Sum of weighted squared distances to planes and points: x' A x - 2 b' x + c (Garland & Heckbert 1997).
class Quadric {
 public:
  void addPlane(const Eigen::Vector3d& unit_normal, const Eigen::Vector3d& point, double weight) {
    const double d = unit_normal.dot(point);
    a_ += weight * unit_normal * unit_normal.transpose();
    b_ += weight * d * unit_normal;
    c_ += weight * d * d;
  }
  void addPoint(const Eigen::Vector3d& point, double weight) {
    a_.diagonal().array() += weight;
    b_ += weight * point;
    c_ += weight * point.squaredNorm();
  }
  Quadric& operator+=(const Quadric& other) {
    a_ += other.a_;
    b_ += other.b_;
    c_ += other.c_;
    return *this;
  }
  [[nodiscard]] double at(const Eigen::Vector3d& x) const {
    return std::max(0.0, x.dot(a_ * x) - 2 * b_.dot(x) + c_);
  }
  // Where the sum is least; there is one such place as soon as a point was added.
  [[nodiscard]] Eigen::Vector3d minimum() const { return a_.inverse() * b_; }

 private:
  Eigen::Matrix3d a_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b_ = Eigen::Vector3d::Zero();
  double c_ = 0;
};

// Edge collapses on OpenMesh's connectivity, cheapest first. OpenMesh's own decimater tests all edges around
// each changed vertex; here an edge is tested only when it is the cheapest.
class Decimation {
 public:
  Decimation(const TileMesh& tile, SimplifyCounts& counts);
  void run(std::size_t target_triangles);
  [[nodiscard]] double area() const { return area_; }                      // of the input [m^2]
  [[nodiscard]] std::size_t borderEdges() const { return border_edges_; }  // that stay as they are
  [[nodiscard]] TileMesh result() const;

 private:
  using Mesh_ = OpenMesh::TriConnectivity;
  struct Turn {
    std::uint32_t rank, edge, stamp;
    // The least rank comes first out of a heap; of equals the first edge.
    bool operator<(const Turn& o) const { return rank != o.rank ? rank > o.rank : edge > o.edge; }
  };
  struct Collapse {
    Mesh_::HalfedgeHandle halfedge;  // its start goes, its end stays
    Eigen::Vector3d place;           // where the end is then
    double cost;
  };

  void addFaces(std::size_t vertices);
  // Closes holes of up to `most_edges` (3 or 4) and `largest` [m2]; returns their number.
  std::size_t closeHoles(std::size_t most_edges, double largest);
  bool closeHole(const std::vector<Mesh_::HalfedgeHandle>& outline, double largest);
  void collapseTo(std::size_t faces);
  void addQuadrics();
  void pushAll();
  void push(Mesh_::EdgeHandle edge);
  [[nodiscard]] bool plan(Mesh_::EdgeHandle edge, Collapse& collapse) const;
  [[nodiscard]] bool allowed(const Collapse& collapse);
  [[nodiscard]] bool staysWell(Mesh_::VertexHandle vertex, Mesh_::VertexHandle other,
                               const Eigen::Vector3d& place) const;
  void apply(const Collapse& collapse);
  void blend(std::size_t from, std::size_t to, const Eigen::Vector3d& place);
  [[nodiscard]] const Eigen::Vector3d& at(Mesh_::VertexHandle v) const {
    return position_[static_cast<std::size_t>(v.idx())];
  }
  [[nodiscard]] bool fixed(Mesh_::VertexHandle v) const {
    return fixed_[static_cast<std::size_t>(v.idx())] != 0;
  }

  const TileMesh& tile_;
  SimplifyCounts& counts_;
  ManifoldParts parts_;
  Mesh_ mesh_;
  Eigen::Vector3d origin_;     // of the positions below: on the lattice
  Eigen::Array2d low_, high_;  // box of the vertices that are not shared
  std::vector<Eigen::Vector3d> position_;
  std::vector<Eigen::Vector3d> facing_;  // sum of the area vectors of all original faces of a vertex
  std::vector<Quadric> quadric_;
  std::vector<std::uint8_t> fixed_, sides_;
  std::vector<float> sigma_, views_;
  std::vector<Eigen::Vector3f> colour_;
  std::vector<std::array<std::uint32_t, 3>> stranded_;  // of the parts' vertices
  std::vector<std::uint32_t> stamp_;                    // an edge: of its newest turn
  std::vector<Turn> turns_;
  std::size_t faces_ = 0;
  double area_ = 0;
  std::size_t border_edges_ = 0;
};

}  // namespace fathom::surface
