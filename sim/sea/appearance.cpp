#include "sim/sea/appearance.hpp"

#include <algorithm>
#include <limits>

#include "sim/sea/ground/surface_scene.hpp"

namespace fathom::sim {

Appearance::Appearance(const SeaTerrain& terrain)
    : terrain_(terrain), detail_(SurfaceDetail::of(terrain.config())) {}

std::optional<Appearance::Look> Appearance::look(const Eigen::Vector3d& origin,
                                                 const Eigen::Vector3d& direction, double footprint_m) const {
  const SurfaceScene& scene = terrain_.surface();
  const Eigen::Vector3f from = (origin - scene.origin()).cast<float>();
  const Eigen::Vector3f along = direction.normalized().cast<float>();
  const auto hit = scene.firstHit(from, along, std::numeric_limits<float>::infinity());
  if (!hit) return std::nullopt;
  const auto footprint = static_cast<float>(footprint_m);
  SurfacePoint surface = scene.look(hit->geometry, hit->primitive, hit->u, hit->v, footprint);
  if (surface.normal.dot(along) > 0) surface.normal = -surface.normal;
  const Eigen::Vector3f place = from + hit->distance_m * along;
  detail_.apply(place, footprint, surface);
  return Look{place.cast<double>() + scene.origin(), surface.albedo,
              std::max(0.0F, -surface.normal.dot(along))};
}

}  // namespace fathom::sim
