#include "recon/topside/localise/feature_stage.hpp"

#include <optional>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/topside/input/scout_planes.hpp"

namespace fathom::topside {
namespace {

constexpr std::size_t kFewFeatures = 10;  // tell no range
constexpr double kFalseBottom = 0.65;     // of the range that stereo sees; a reef's relief stays above

// To what the frame's features show; nothing for few.
std::optional<double> medianRange(const Frames& frames, std::size_t frame) {
  closure::FrameFeatures seen;
  if (frames.blank(frame)) return std::nullopt;
  frames.load(frame, seen);
  if (seen.size() < kFewFeatures) return std::nullopt;
  std::vector<double> z;
  for (const closure::Feature& feature : seen.features) z.push_back(feature.point.z());
  return median(z);
}

}  // namespace

void grow(closure::FrameFeatures& features, double scale) {
  const auto by = static_cast<float>(scale);
  for (closure::Feature& feature : features.features) {
    feature.point *= by;
    for (float& of : feature.covariance) of *= by * by;
  }
}

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
    frames.travelled.push_back(frames.travelled.empty() ? 0 : frames.travelled.back() + step);
    frames.reckoned.push_back(T_nav_cam);
    frames.range.push_back(survey.planes[k]->ahead());
    const double seen = medianRange(frames, frames.range.size() - 1).value_or(frames.range.back());
    // The DVL does not tell how far a wall is.
    const bool ahead = (T_nav_cam.rotation() * Eigen::Vector3d::UnitZ()).z() < kLooksAhead;
    frames.false_bottom.push_back(!ahead && frames.range.back() < kFalseBottom * seen);
    if (ahead || frames.false_bottom.back()) frames.range.back() = seen;
  }
  return frames;
}

}  // namespace fathom::topside
