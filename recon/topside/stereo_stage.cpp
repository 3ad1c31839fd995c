#include "recon/topside/stereo_stage.hpp"

#include <algorithm>

#include "firmware_if/image_file.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::topside {
namespace {

ImageView view8(const std::vector<std::uint8_t>& pixels, const Camera& camera, PixelFormat format) {
  const std::size_t channels = format == PixelFormat::kRgb ? 3 : 1;
  return {pixels.data(), camera.width,
          camera.height, static_cast<std::size_t>(camera.width) * channels,
          format,        8};
}

std::size_t pixels(const Camera& camera) {
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

// Radius of a circle around the middle of the mesh's box, in plan.
double footprintRadius(const Mesh& mesh) {
  if (mesh.vertices.empty()) return 0;
  Eigen::Vector2f low = mesh.vertices[0].head<2>(), high = low;
  for (const auto& v : mesh.vertices) {
    low = low.cwiseMin(v.head<2>());
    high = high.cwiseMax(v.head<2>());
  }
  return 0.5 * static_cast<double>((high - low).norm());
}

}  // namespace

stereo::SeedPlane seedPlane(const io::MissionConfig& mission, const SE3& T_nav_body, double altitude) {
  const SE3 T_nav_cam = T_nav_body * mission.T_body_cam;
  const double bottom = (T_nav_body * mission.T_body_dvl.translation()).z() + altitude;
  stereo::SeedPlane plane;
  plane.normal = T_nav_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  plane.distance = bottom - T_nav_cam.translation().z();
  return plane;
}

StereoStage::StereoStage(const io::MissionPaths& paths, const io::MissionConfig& mission,
                         const StereoRig& rig, const TopsideConfig& config, const LightingModels& models)
    : paths_(paths),
      mission_(mission),
      rig_(rig),
      config_(config),
      models_(models),
      sparse_(rig, config.stereo),
      left_(pixels(rig.left)),
      right_(pixels(rig.right)),
      left_mono_(pixels(rig.left)),
      right_mono_(pixels(rig.right)),
      left_rgb_(pixels(rig.left) * 3) {
  if (config.dense_stereo) dense_.emplace(rig, config.stereo, config.dense);
}

PairResult StereoStage::process(const ImagePair& pair, const SE3& T_nav_body, double altitude) {
  PairResult result;
  result.T_nav_cam = T_nav_body * mission_.T_body_cam;
  Stopwatch watch;
  io::ImageFile left, right;
  try {
    const auto& cameras = mission_.cameras;
    left = io::readImage(paths_.images() / pair.left, cameras.left_format, cameras.bits, rig_.left.width,
                         rig_.left.height);
    right = io::readImage(paths_.images() / pair.right, cameras.right_format, cameras.bits, rig_.right.width,
                          rig_.right.height);
  } catch (const InputError& error) {
    result.unreadable = error.what();
    return result;
  }
  result.times[PairStage::kRead] = watch.lap();

  models_.left.correct(left.view, left_.data());
  models_.right.correct(right.view, right_.data());
  const ImageView left_mosaic = view8(left_, rig_.left, mission_.cameras.left_format);
  const ImageView right_mosaic = view8(right_, rig_.right, mission_.cameras.right_format);
  lighting::demosaicMono(left_mosaic, left_mono_.data());
  lighting::demosaicMono(right_mosaic, right_mono_.data());
  lighting::demosaicRgb(left_mosaic, left_rgb_.data());
  result.times[PairStage::kLighting] = watch.lap();

  const ImageView left_view = view8(left_mono_, rig_.left, PixelFormat::kMono);
  const ImageView right_view = view8(right_mono_, rig_.right, PixelFormat::kMono);
  const stereo::SeedPlane plane = seedPlane(mission_, T_nav_body, altitude);
  const stereo::StereoResult& found =
      dense_ ? dense_->process(left_view, right_view, plane) : sparse_.process(left_view, right_view, plane);
  result.points = found.points.size();
  result.corners = found.corners;
  result.rejected = found.rejected;
  result.times[PairStage::kStereo] = watch.lap();

  if (found.points.size() >= static_cast<std::size_t>(config_.min_points) && !found.triangles.empty()) {
    result.mesh = stereo::toMesh(found, view8(left_rgb_, rig_.left, PixelFormat::kRgb));
    transform(result.mesh, result.T_nav_cam);
    result.footprint_radius = footprintRadius(result.mesh);
  }
  result.times[PairStage::kMesh] = watch.lap();
  return result;
}

}  // namespace fathom::topside
