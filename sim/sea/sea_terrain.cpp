#include "sim/sea/sea_terrain.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/ply.hpp"
#include "sim/scenario/key_range_check.hpp"
#include "sim/scenario/scenario.hpp"
#include "sim/sea/ground/seafloor.hpp"
#include "sim/sea/ground/surface_scene.hpp"
#include "sim/sea/light/surface_detail.hpp"

namespace fathom::sim {
namespace {

constexpr float kFarAway = 1e5F;  // [m], farther than any terrain is wide

Eigen::Vector3d meanVertex(const Mesh& mesh) {
  Eigen::Vector3d low = mesh.vertices[0].cast<double>(), high = low;
  double depth = 0.0;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    low = low.cwiseMin(v.cast<double>());
    high = high.cwiseMax(v.cast<double>());
    depth += v.z();
  }
  Eigen::Vector3d centre = 0.5 * (low + high);
  centre.z() = depth / static_cast<double>(mesh.vertices.size());
  return centre;
}

// Mean edge of a texel on the surface [m]: root of the ratio of the area in space to the area in texels.
float texelSize(const Mesh& mesh, const TextureImage& texture) {
  double area = 0.0, texels = 0.0;
  for (const auto& [a, b, c] : mesh.triangles) {
    area += (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm();
    const Eigen::Vector2f p = mesh.texture_coordinates[b] - mesh.texture_coordinates[a];
    const Eigen::Vector2f q = mesh.texture_coordinates[c] - mesh.texture_coordinates[a];
    texels += std::abs(p.x() * q.y() - p.y() * q.x()) * texture.width() * texture.height();
  }
  return texels > 0 ? static_cast<float>(std::sqrt(area / texels)) : 1.0F;
}

void loadSurface(const TerrainConfig& config, SurfaceScene& scene) {
  Mesh mesh = readPly(config.mesh_file);
  if (mesh.triangles.empty())
    throw InputError(config.mesh_file, "", "holds no triangles; a terrain needs a surface, not points");
  if (mesh.normals.empty()) computeNormals(mesh);
  TriangleSurface surface;
  if (!config.texture_file.empty()) {
    if (mesh.texture_coordinates.empty())
      throw InputError(config.mesh_file, "", "has no texture coordinates s t; leave the texture image out");
    surface.texture = std::make_shared<TextureImage>(config.texture_file);
    surface.texel_m = texelSize(mesh, *surface.texture);
    surface.texture_coordinates = std::move(mesh.texture_coordinates);
  }
  const Eigen::Vector3d centre = meanVertex(mesh);
  surface.covers.resize(mesh.vertices.size(), Cover{{150, 145, 135}, 128});
  for (std::size_t i = 0; i < mesh.colours.size(); ++i) surface.covers[i].colour = mesh.colours[i];
  for (Eigen::Vector3f& v : mesh.vertices)
    v -= centre.cast<float>();  // scene.origin() is where the centre goes
  surface.vertices = std::move(mesh.vertices);
  surface.normals = std::move(mesh.normals);
  surface.triangles = std::move(mesh.triangles);
  scene.add(std::move(surface));
  scene.commit();
}

}  // namespace

SeaTerrain::SeaTerrain(const TerrainConfig& config) : config_(config) {
  validate(config);
  detail_ = std::make_unique<const SurfaceDetail>(SurfaceDetail::of(config));
  surface_ = std::make_unique<SurfaceScene>(
      Eigen::Vector3d(config.centre_north_m, config.centre_east_m, config.base_depth_m));
  if (config.kind == TerrainKind::kMesh) {
    loadSurface(config, *surface_);
  } else {
    buildSeafloor(config, *surface_);
  }
}

SeaTerrain::~SeaTerrain() = default;

std::optional<double> SeaTerrain::castRay(const Eigen::Vector3d& origin,
                                          const Eigen::Vector3d& direction) const {
  return surface_->castRay((origin - surface_->origin()).cast<float>(), direction.normalized().cast<float>(),
                           kFarAway);
}

std::optional<double> SeaTerrain::depthAt(double north_m, double east_m) const {
  const double start = surface_->lower().z() - 1.0;
  const std::optional<double> fall = castRay({north_m, east_m, start}, Eigen::Vector3d::UnitZ());
  if (!fall) return std::nullopt;
  return start + *fall;
}

Mesh SeaTerrain::mesh() const {
  Mesh mesh = surface_->mesh();
  if (config_.albedo_images.empty()) return mesh;
  const auto footprint_m = static_cast<float>(config_.grid_spacing_m);
  const Eigen::Vector3f origin = surface_->origin().cast<float>();
  computeNormals(mesh);
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    SurfacePoint point;
    point.normal = mesh.normals[i];
    detail_->apply(mesh.vertices[i] - origin, footprint_m, point);
    mesh.colours[i] = srgbFromLinear(Eigen::Vector3f(point.albedo.data()).cast<double>());
  }
  mesh.normals.clear();
  return mesh;
}
const Eigen::Vector3d& SeaTerrain::lower() const {
  return surface_->lower();
}
const Eigen::Vector3d& SeaTerrain::upper() const {
  return surface_->upper();
}
const TerrainConfig& SeaTerrain::config() const {
  return config_;
}

double WideSeafloor::depthAt(double north_m, double east_m) const {
  if (const auto depth = terrain_.depthAt(north_m, east_m)) return *depth;
  constexpr double kInside = 0.05;  // keeps clear of the last row of triangles [m]
  const Eigen::Vector3d &low = terrain_.lower(), &high = terrain_.upper();
  const double north = std::clamp(north_m, low.x() + kInside, high.x() - kInside);
  const double east = std::clamp(east_m, low.y() + kInside, high.y() - kInside);
  return terrain_.depthAt(north, east).value_or(terrain_.config().base_depth_m);
}

std::optional<double> WideSeafloor::castRay(const Eigen::Vector3d& origin,
                                            const Eigen::Vector3d& direction) const {
  if (const auto distance = terrain_.castRay(origin, direction)) return distance;
  constexpr double kGrazing = 0.05;  // a flatter ray has no useful range to a flat seafloor
  if (direction.z() < kGrazing) return std::nullopt;
  // Intersects the plane at the mean depth first, then twice that at the depth found there.
  double depth = terrain_.config().base_depth_m;
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d arrival = origin + (depth - origin.z()) / direction.z() * direction;
    depth = depthAt(arrival.x(), arrival.y());
  }
  const double distance = (depth - origin.z()) / direction.z();
  return distance > 0 ? std::optional<double>(distance) : std::nullopt;
}

}  // namespace fathom::sim
