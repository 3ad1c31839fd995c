#include "sim/sea/terrain.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/mesh_io.hpp"
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

void requireSizes(double density, double low, double high, const char* what) {
  require(density >= 0 && density <= 200 && low > 0 && high >= low && high <= 20, what);
}

}  // namespace

void validate(const TerrainConfig& c) {
  require(std::isfinite(c.centre_north_m) && std::isfinite(c.centre_east_m), "centre must be finite");
  require(c.base_depth_m >= 0 && c.base_depth_m <= 11000, "base_depth_m must be 0 to 11000");
  require(c.detail_contrast >= 0 && c.detail_contrast <= 1, "detail_contrast must be 0 to 1");
  require(c.fish >= 0 && c.fish <= 1000, "fish must be 0 to 1000");
  require(c.swaying_density_per_m2 >= 0 && c.swaying_density_per_m2 <= 20,
          "swaying_density_per_m2 must be 0 to 20");
  if (c.kind == TerrainKind::kMesh) {
    require(!c.mesh_file.empty(), "mesh_file must be given for a mesh");
    return;
  }
  require(c.size_north_m >= 1 && c.size_north_m <= 500 && c.size_east_m >= 1 && c.size_east_m <= 500,
          "size_north_m and size_east_m must be 1 to 500");
  require(c.grid_spacing_m >= 0.005 && c.grid_spacing_m <= 1, "grid_spacing_m must be 0.005 to 1");
  constexpr double kMaxVertices = 40e6;  // about 2 GB
  require(c.size_north_m * c.size_east_m / (c.grid_spacing_m * c.grid_spacing_m) <= kMaxVertices,
          "size over grid_spacing_m gives more than 40 million vertices; widen the spacing");
  require(c.size_north_m / c.grid_spacing_m < 30000 && c.size_east_m / c.grid_spacing_m < 30000,
          "size over grid_spacing_m gives more than 30000 vertices a side; widen the spacing");
  require(c.undulation_m >= 0 && c.undulation_m <= 10, "undulation_m must be 0 to 10");
  require(c.undulation_wavelength_m >= 0.5 && c.undulation_wavelength_m <= 1000,
          "undulation_wavelength_m must be 0.5 to 1000");
  require(c.roughness_m >= 0 && c.roughness_m <= 0.2, "roughness_m must be 0 to 0.2");
  require(c.ripples.height_m >= 0 && c.ripples.height_m <= 1, "ripples.height_m must be 0 to 1");
  require(c.ripples.wavelength_m >= 0.02 && c.ripples.wavelength_m <= 10,
          "ripples.wavelength_m must be 0.02 to 10");
  require(std::isfinite(c.ripples.direction_rad), "ripples.direction_rad must be finite");
  requireSizes(c.rubble.density_per_m2, c.rubble.min_size_m, c.rubble.max_size_m,
               "rubble needs a density of 0 to 200 per m2 and 0 < min_size_m <= max_size_m <= 20");
  require(c.rubble.patchiness >= 0 && c.rubble.patchiness <= 1, "rubble.patchiness must be 0 to 1");
  requireSizes(c.boulders.density_per_m2, c.boulders.min_size_m, c.boulders.max_size_m,
               "boulders need a density of 0 to 200 per m2 and 0 < min_size_m <= max_size_m <= 20");
  requireSizes(c.corals.density_per_m2, c.corals.min_size_m, c.corals.max_size_m,
               "corals need a density of 0 to 200 per m2 and 0 < min_size_m <= max_size_m <= 20");
  require(c.corals.overhang >= 0 && c.corals.overhang <= 0.8, "corals.overhang must be 0 to 0.8");
  require(c.ripples.meander >= 0 && c.ripples.meander <= 1, "ripples.meander must be 0 to 1");
  for (const PlacedConfig& thing : c.placed) {
    require(std::isfinite(thing.north_m) && std::isfinite(thing.east_m) && std::isfinite(thing.heading_rad),
            "placed things' north_m, east_m and heading_rad must be finite");
    require(thing.size_m > 0 && thing.size_m <= 20, "placed things need 0 < size_m <= 20");
  }
  for (const LedgeConfig& ledge : c.ledges) {
    require(std::isfinite(ledge.north_m) && std::isfinite(ledge.east_m) && std::isfinite(ledge.heading_rad),
            "ledges' north_m, east_m and heading_rad must be finite");
    require(ledge.drop_m > 0 && ledge.drop_m <= 50 && ledge.width_m >= 0 && ledge.width_m <= 100 &&
                ledge.undercut_m >= 0 && ledge.undercut_m <= 5,
            "ledges need 0 < drop_m <= 50, 0 <= width_m <= 100, 0 <= undercut_m <= 5");
  }
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
