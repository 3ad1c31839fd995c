#pragma once

#include <embree3/rtcore.h>

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "sim/sea/ground/texture_image.hpp"

namespace fathom::sim {

// Cover of a surface: its albedo, and the strength of its fine texture.
struct Cover {
  Rgb colour{128, 128, 128};  // sRGB
  std::uint8_t hardness = 0;  // 0 loose sand, 255 rock and coral: coarser, stronger texture
};

// A rectangle of vertices, row after row along north, that may be displaced in all directions.
struct GridSurface {
  int rows = 0, columns = 0;
  std::vector<Eigen::Vector3f> vertices;  // local frame [m]
  std::vector<Eigen::Vector3f> normals;   // unit, upwards
  std::vector<Cover> covers;
};

struct TriangleSurface {
  std::vector<Eigen::Vector3f> vertices;  // local frame [m]
  std::vector<Eigen::Vector3f> normals;
  std::vector<Cover> covers;  // unused where there is a texture
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<Eigen::Vector2f> texture_coordinates;
  std::shared_ptr<const TextureImage> texture;
  float texel_m = 0;  // mean size of a texel on the surface

  void append(const TriangleSurface& other);
};

// Properties of a hit for shading.
struct SurfacePoint {
  Eigen::Vector3f normal;         // unit, interpolated between vertices; either side
  std::array<float, 3> albedo{};  // linear
  float hardness = 0;             // 0 to 1
  float resolved_m = 0;           // size of the finest detail that the albedo holds
};

struct SurfaceHit {
  float distance_m = 0;
  Eigen::Vector3f normal;  // of the triangle, unit, either side
  unsigned geometry = 0, primitive = 0;
  float u = 0, v = 0;
};

// Embree 3.13 misses a grid when a ray hits it exactly in a vertex. Rays without a hit are cast again with
// this added to their unit direction (micrometres on the surface).
inline const Eigen::Vector3f kNudge(1.1e-6F, 0.7e-6F, -0.4e-6F);

// Surfaces under one Embree scene, in a local frame: nav less `origin`, so that floats resolve micrometres.
class SurfaceScene {
 public:
  explicit SurfaceScene(const Eigen::Vector3d& origin_nav);
  ~SurfaceScene();
  SurfaceScene(const SurfaceScene&) = delete;
  SurfaceScene& operator=(const SurfaceScene&) = delete;

  // Before commit(). The scene keeps the surfaces.
  void add(GridSurface surface);
  void add(TriangleSurface surface);
  // Builds the tree on one thread, so that its shape, and with it every tie between triangles, is
  // reproducible. May be called again after further add().
  void commit();

  [[nodiscard]] bool empty() const { return parts_.empty(); }
  [[nodiscard]] RTCScene scene() const { return scene_; }
  [[nodiscard]] const Eigen::Vector3d& origin() const { return origin_; }
  // `footprint_m`: size of the pixel on the surface.
  [[nodiscard]] SurfacePoint look(unsigned geometry, unsigned primitive, float u, float v,
                                  float footprint_m) const;
  [[nodiscard]] std::optional<SurfaceHit> firstHit(const Eigen::Vector3f& origin,
                                                   const Eigen::Vector3f& unit_direction,
                                                   float limit_m) const;
  [[nodiscard]] std::optional<float> castRay(const Eigen::Vector3f& origin,
                                             const Eigen::Vector3f& unit_direction, float limit_m) const;
  // Depth of the first surface seen from above, both in the local frame [m]; none where a ray meets nothing.
  [[nodiscard]] std::optional<float> depthAt(float north_m, float east_m) const;
  [[nodiscard]] bool occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& unit_direction,
                              float limit_m) const;
  [[nodiscard]] Mesh mesh() const;                                       // in nav
  [[nodiscard]] const Eigen::Vector3d& lower() const { return lower_; }  // in nav, after commit()
  [[nodiscard]] const Eigen::Vector3d& upper() const { return upper_; }

 private:
  struct Part {
    GridSurface grid;           // either this
    TriangleSurface triangles;  // or this
    RTCGrid embree_grid{};
    [[nodiscard]] bool isGrid() const { return grid.rows > 0; }
  };
  void attach(RTCGeometry geometry, Part& part);

  Eigen::Vector3d origin_;
  Eigen::Vector3d lower_, upper_;
  RTCScene scene_ = nullptr;
  std::vector<std::unique_ptr<Part>>
      parts_;  // index: Embree's geometry id; addresses stay, Embree points into them
  std::vector<RTCGeometry> geometries_;
};

}  // namespace fathom::sim
