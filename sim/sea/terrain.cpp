#include "sim/sea/terrain.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "sim/scenario/range_check.hpp"
#include "sim/scenario/scenario.hpp"
#include "sim/sea/ground/seafloor.hpp"
#include "sim/sea/ground/surface_scene.hpp"

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

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(std::string("terrain: ") + what);
}

}  // namespace

void validate(const TerrainConfig& c) {
  TerrainConfig walked = c;
  RangeCheck check;
  visitTerrain(check, walked);
  require(walked.ledges.size() == c.ledges.size() && walked.placed.size() == c.placed.size(),
          "there are at most 20 ledges and 100 placed things");
  if (c.kind == TerrainKind::kMesh) {
    require(!c.mesh_file.empty(), "mesh_file must be given for a mesh");
    return;
  }
  constexpr double kMaxVertices = 40e6;  // about 2 GB
  require(c.size_north_m * c.size_east_m / (c.grid_spacing_m * c.grid_spacing_m) <= kMaxVertices,
          "size over grid_spacing_m gives more than 40 million vertices; widen the spacing");
  require(c.size_north_m / c.grid_spacing_m < 30000 && c.size_east_m / c.grid_spacing_m < 30000,
          "size over grid_spacing_m gives more than 30000 vertices a side; widen the spacing");
  require(c.rubble.min_size_m <= c.rubble.max_size_m, "rubble needs min_size_m <= max_size_m");
  require(c.boulders.min_size_m <= c.boulders.max_size_m, "boulders need min_size_m <= max_size_m");
  require(c.corals.min_size_m <= c.corals.max_size_m, "corals need min_size_m <= max_size_m");
}

Terrain::Terrain(const TerrainConfig& config) : config_(config) {
  validate(config);
  surface_ = std::make_unique<SurfaceScene>(
      Eigen::Vector3d(config.centre_north_m, config.centre_east_m, config.base_depth_m));
  if (config.kind == TerrainKind::kMesh) {
    loadSurface(config, *surface_);
  } else {
    buildSeafloor(config, *surface_);
  }
}

Terrain::~Terrain() = default;

std::optional<double> Terrain::castRay(const Eigen::Vector3d& origin,
                                       const Eigen::Vector3d& direction) const {
  return surface_->castRay((origin - surface_->origin()).cast<float>(), direction.normalized().cast<float>(),
                           kFarAway);
}

std::optional<double> Terrain::depthAt(double north_m, double east_m) const {
  const double start = surface_->lower().z() - 1.0;
  const std::optional<double> fall = castRay({north_m, east_m, start}, Eigen::Vector3d::UnitZ());
  if (!fall) return std::nullopt;
  return start + *fall;
}

Mesh Terrain::mesh() const {
  return surface_->mesh();
}
const Eigen::Vector3d& Terrain::lower() const {
  return surface_->lower();
}
const Eigen::Vector3d& Terrain::upper() const {
  return surface_->upper();
}
const TerrainConfig& Terrain::config() const {
  return config_;
}

}  // namespace fathom::sim
