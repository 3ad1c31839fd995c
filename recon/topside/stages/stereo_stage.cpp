#include "recon/topside/stages/stereo_stage.hpp"

#include "recon/topside/stages/seed_plane.hpp"

namespace fathom::topside {
StereoStage::StereoStage(const io::MissionPaths& paths, const io::MissionConfig& mission,
                         const StereoRig& rig, const TopsideConfig& config, const LightingModels& models)
    : mission_(mission), config_(config), images_(paths, mission, rig, models), sparse_(rig, config.stereo) {
  if (config.dense_stereo) dense_.emplace(rig, config.stereo, config.dense);
}

PairResult StereoStage::process(const ImagePair& pair, const SE3& T_nav_body, double altitude) {
  PairResult result;
  result.T_nav_cam = T_nav_body * mission_.T_body_cam;
  Stopwatch watch;
  if (!images_.read(pair)) {
    result.unreadable = images_.error();
    return result;
  }
  result.times[PairStage::kRead] = watch.lap();
  const stereo::SeedPlane plane = seedPlane(mission_, T_nav_body, altitude);
  images_.correct(plane);
  result.times[PairStage::kLighting] = watch.lap();

  const stereo::StereoResult& found = dense_ ? dense_->process(images_.left(), images_.right(), plane)
                                             : sparse_.process(images_.left(), images_.right(), plane);
  result.points = found.points.size();
  result.corners = found.corners;
  result.rejected = found.rejected;
  result.times[PairStage::kStereo] = watch.lap();

  if (found.points.size() >= static_cast<std::size_t>(config_.min_points) && !found.triangles.empty()) {
    result.mesh = stereo::toMesh(found, images_.colours(found.points));
    transform(result.mesh, result.T_nav_cam);
    result.footprint_radius = footprintRadius(result.mesh);
  }
  result.times[PairStage::kMesh] = watch.lap();
  return result;
}

}  // namespace fathom::topside
