#include "recon/topside/stages/stereo_stage.hpp"

#include <algorithm>

#include "firmware_if/image_file.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::topside {
namespace {

std::size_t samplesPerPixel(PixelFormat format) {
  return format == PixelFormat::kRgb ? 3 : 1;
}

ImageView view8(const std::vector<std::uint8_t>& pixels, const Camera& camera, PixelFormat format) {
  return {pixels.data(), camera.width,
          camera.height, static_cast<std::size_t>(camera.width) * samplesPerPixel(format),
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

StereoStage::StereoStage(const io::MissionPaths& paths, const io::MissionConfig& mission,
                         const StereoRig& rig, const TopsideConfig& config, const LightingModels& models)
    : paths_(paths),
      mission_(mission),
      rig_(rig),
      config_(config),
      models_(models),
      sparse_(rig, config.stereo),
      ranges_(rig),
      left_(pixels(rig.left) * samplesPerPixel(mission.cameras.left_format)),
      right_(pixels(rig.right) * samplesPerPixel(mission.cameras.right_format)),
      left_mono_(pixels(rig.left)),
      right_mono_(pixels(rig.right)),
      left_rgb_(pixels(rig.left) * 3) {
  if (config.dense_stereo) dense_.emplace(rig, config.stereo, config.dense);
}

void StereoStage::correctColours(const ImageView& left, const stereo::StereoResult& found) {
  std::vector<Eigen::Vector3f> points, right_points(found.points.size());
  for (const stereo::StereoPoint& p : found.points) points.push_back(p.point);
  ranges_.bendTo(points, right_points);
  models_.left.correct(left, ranges_.left(), left_.data());
  lighting::demosaicRgb(view8(left_, rig_.left, mission_.cameras.left_format), left_rgb_.data());
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

  const stereo::SeedPlane plane = seedPlane(mission_, T_nav_body, altitude);
  ranges_.fromPlane(plane.normal, plane.distance);
  models_.left.correct(left.view, ranges_.left(), left_.data());
  models_.right.correct(right.view, ranges_.right(), right_.data());
  const ImageView left_mosaic = view8(left_, rig_.left, mission_.cameras.left_format);
  const ImageView right_mosaic = view8(right_, rig_.right, mission_.cameras.right_format);
  lighting::demosaicMono(left_mosaic, left_mono_.data());
  lighting::demosaicMono(right_mosaic, right_mono_.data());
  result.times[PairStage::kLighting] = watch.lap();

  const ImageView left_view = view8(left_mono_, rig_.left, PixelFormat::kMono);
  const ImageView right_view = view8(right_mono_, rig_.right, PixelFormat::kMono);
  const stereo::StereoResult& found =
      dense_ ? dense_->process(left_view, right_view, plane) : sparse_.process(left_view, right_view, plane);
  result.points = found.points.size();
  result.corners = found.corners;
  result.rejected = found.rejected;
  result.times[PairStage::kStereo] = watch.lap();

  if (found.points.size() >= static_cast<std::size_t>(config_.min_points) && !found.triangles.empty()) {
    correctColours(left.view, found);
    result.mesh = stereo::toMesh(found, view8(left_rgb_, rig_.left, PixelFormat::kRgb));
    transform(result.mesh, result.T_nav_cam);
    result.footprint_radius = footprintRadius(result.mesh);
  }
  result.times[PairStage::kMesh] = watch.lap();
  return result;
}

}  // namespace fathom::topside
