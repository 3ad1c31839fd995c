#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/se3.hpp"
#include "sim/sea/ground/surface_scene.hpp"
#include "sim/sea/light/daylight.hpp"
#include "sim/sea/light/surface_detail.hpp"
#include "sim/sea/light/water_light.hpp"

namespace fathom::sim {

// Scene, light and camera of one picture.
struct Shot {
  const SurfaceScene& bed;
  const SurfaceScene* moving;  // or nullptr
  const SurfaceDetail& detail;
  const WaterAttenuation& attenuation;
  const Backscatter& backscatter;
  const Daylight& daylight;
  const std::vector<Beam>& beams;
  std::vector<Eigen::Vector3f> strobe_positions;   // in the bed's local frame
  std::vector<Eigen::Vector3f> strobe_directions;  // unit
  Eigen::Vector3f camera;                          // position in the local frame
  float origin_depth;                              // of the local frame, below the surface [m]
  Eigen::Matrix3f R_local_cam;
  float focal_px;
};

// Up to eight view rays that are traced together.
struct RayBundle {
  static constexpr int kSize = 8;
  int count = 0;
  float x_px[kSize], y_px[kSize];     // where in the image
  Eigen::Vector2f normalised[kSize];  // (x/z, y/z) in the camera frame
  Eigen::Vector3f origin[kSize];      // where the ray begins there
  Radiance radiance[kSize];           // result
  float inverse_range[kSize];         // [1/m], 0 where the ray meets nothing
  std::uint32_t lit[kSize];           // bit s: strobe s shines on the point
};

// Traces view and shadow rays, and shades the hits (equation: renderer.hpp).
void trace(const Shot& shot, RayBundle& rays);

}  // namespace fathom::sim
