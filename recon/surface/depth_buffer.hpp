#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/surface/view_projection.hpp"

namespace fathom::surface {

// Surfaces that may hide others, in single precision relative to an origin near them, in patches that a view
// can skip as a whole.
struct Occluders {
  struct Patch {
    Eigen::Vector3f middle = Eigen::Vector3f::Zero();
    float radius = 0;
    std::uint32_t first_vertex = 0, vertices = 0, first_triangle = 0, triangles = 0;
  };
  Occluders() = default;
  Occluders(const std::vector<const Mesh*>& meshes, const Eigen::Vector3d& origin);

  std::vector<Patch> patches;
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;  // of vertices counted from their patch's first
};

// Depth buffer of one view in cells of kCell x kCell pixels: the inverse depth of the nearest face within
// one cell of a cell's centre, reduced by the face's slope over that distance, so that a slope does not
// hide itself.
class DepthBuffer {
 public:
  static constexpr int kCell = 8;  // [px]

  void draw(const Occluders& occluders, const ViewProjection& view);
  // Visibility of a point: 1 without a surface more than `tolerance` [m] before it, falling to 0 over half a
  // cell outside the edge of an occluder, and 0 within a cell of that edge.
  [[nodiscard]] float visibility(float u, float v, float depth, float tolerance) const;

 private:
  struct Vertex {
    float x, y, inverse;  // [cells], [1/m]; inverse 0: not projected
  };
  void drawTriangle(const Vertex& a, const Vertex& b, const Vertex& c);

  int width_ = 0, height_ = 0;  // [cells]
  std::vector<float> nearest_;  // [1/m]; 0: nothing
  std::vector<Vertex> projected_;
};

}  // namespace fathom::surface
