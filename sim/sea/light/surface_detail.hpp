#pragma once

#include <cstdint>
#include <memory>

#include "sim/sea/ground/noise.hpp"
#include "sim/sea/ground/surface_scene.hpp"
#include "sim/sea/ground/texture_image.hpp"
#include "sim/sea/terrain_config.hpp"

namespace fathom::sim {

// Fine texture of sand grains, shell grit, turf and pores: noise that is a function of the place on the
// surface, equal for every camera and pass. Octaves finer than a pixel are left out, against aliasing, and so
// are octaves that the surface's own colour resolves.
class SurfaceDetail {
 public:
  // `contrast`: standard deviation relative to the albedo.
  SurfaceDetail(std::uint64_t seed, double contrast);
  // With albedo from photographs in place of noise.
  SurfaceDetail(std::uint64_t seed, std::shared_ptr<const AlbedoImages> images);
  // The texture configured for a terrain.
  [[nodiscard]] static SurfaceDetail of(const TerrainConfig& terrain);
  // Changes albedo and normal of `point`, seen at `position` (local frame) by a pixel of `footprint_m`.
  void apply(const Eigen::Vector3f& position, float footprint_m, SurfacePoint& point) const;

 private:
  std::shared_ptr<const AlbedoImages> images_;
  NoiseVolume volume_;
  Eigen::Matrix3f lattice_from_local_;  // turns the lattice out of the seafloor's plane
  float contrast_;
};

}  // namespace fathom::sim
