#include "recon/topside/stages/given_pair_stage.hpp"

#include "firmware_if/feature_file.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::topside {

GivenPairStage::GivenPairStage(const io::MissionPaths& paths, const io::MissionConfig& mission,
                               const StereoRig& rig, const TopsideConfig& config)
    : paths_(paths), mission_(mission), config_(config), stereo_(rig, config.stereo) {}

PairResult GivenPairStage::process(const ImagePair& pair, const SE3& T_nav_body, double) {
  PairResult result;
  result.T_nav_cam = T_nav_body * mission_.T_body_cam;
  Stopwatch watch;
  try {
    io::readFeatureFile(paths_.features() / io::featureFileName(pair.left), frame_);
  } catch (const InputError& error) {
    result.unreadable = error.what();
    return result;
  }
  result.times[PairStage::kRead] = watch.lap();
  const stereo::StereoResult& found = stereo_.process(frame_);
  result.points = found.points.size();
  result.corners = found.corners;
  result.rejected = found.rejected;
  result.times[PairStage::kStereo] = watch.lap();
  if (found.points.size() >= static_cast<std::size_t>(config_.min_points) && !found.triangles.empty()) {
    stereo::toMesh(found, frame_, result.mesh);
    transform(result.mesh, result.T_nav_cam);
    result.footprint_radius = footprintRadius(result.mesh);
  }
  result.times[PairStage::kMesh] = watch.lap();
  return result;
}

}  // namespace fathom::topside
