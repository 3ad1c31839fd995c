#include "recon/topside/localise/feature_stage.hpp"

#include <optional>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/calibration/rig_history.hpp"
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

void retriangulate(const StereoRig& from, const StereoRig& to, closure::FrameFeatures& features) {
  const double shorter = from.baseline() / to.baseline();
  for (closure::Feature& feature : features.features) {
    const Eigen::Vector3d before = feature.point.cast<double>(),
                          after = calibration::retriangulated(from, to, before);
    // Across the ray errors go with the range, along it with its square over the baseline.
    const double longer = after.z() / before.z();
    Eigen::Matrix3d J = longer * Eigen::Matrix3d::Identity();
    J.col(2) += (longer * shorter - 1) * longer * before / before.z();
    feature.point = after.cast<float>();
    const Eigen::Matrix3d covariance = J * feature.covarianceMatrix() * J.transpose();
    feature.covariance = closure::upperTriangle(covariance.cast<float>());
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
