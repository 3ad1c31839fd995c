#include "recon/topside/localise/feature_stage.hpp"

namespace fathom::topside {

Frames framesOf(const io::MissionConfig& mission, const Survey& survey, const FeatureStore& features) {
  Frames frames;
  frames.features = &features;
  for (std::size_t k = 0; k < survey.planes.size(); ++k) {
    const auto& pose = survey.navigation.poses[k].T_nav_body;
    if (!pose) continue;
    frames.pair.push_back(static_cast<std::uint32_t>(k));
    const SE3 T_nav_cam = *pose * mission.T_body_cam;
    const double step =
        frames.reckoned.empty() ? 0 : (T_nav_cam.translation() - frames.reckoned.back().translation()).norm();
    frames.way.push_back(frames.way.empty() ? 0 : frames.way.back() + step);
    frames.reckoned.push_back(T_nav_cam);
    frames.altitude.push_back(survey.planes[k]->distance);
  }
  return frames;
}

}  // namespace fathom::topside
