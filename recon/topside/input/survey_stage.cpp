#include "recon/topside/input/survey_stage.hpp"

#include <algorithm>
#include <cmath>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/civil_time.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/input/scout_planes.hpp"

namespace fathom::topside {
namespace {

Survey fromPoses(const MissionInput& input) {
  Survey survey;
  survey.list.features_only = input.features_only;
  std::vector<io::StereoPose> poses = input.given_poses->poses;
  std::stable_sort(poses.begin(), poses.end(),
                   [](const io::StereoPose& a, const io::StereoPose& b) { return a.utc_s < b.utc_s; });
  for (const io::StereoPose& pose : poses) {
    if (!io::nameInside(pose.left_image) || !io::nameInside(pose.right_image))
      throw InputError(input.paths.root.string(), "stereo_pose_est.data",
                       "pose " + std::to_string(pose.id) + " names no image files");
    NavigatedPose navigated;
    navigated.utc_ns = rt::nanoseconds(pose.utc_s);
    navigated.T_nav_body = pose.T_nav_cam * input.mission.T_body_cam.inverse();
    if (pose.altitude > 0) navigated.altitude = pose.altitude;
    survey.list.pairs.push_back({navigated.utc_ns, pose.left_image, pose.right_image});
    survey.navigation.poses.push_back(navigated);
  }
  if (survey.list.pairs.empty())
    throw InputError(input.paths.root.string(), "stereo_pose_est.data", "holds no pose");
  survey.navigation.track = survey.navigation.poses;
  survey.navigation.anchor.source = "given poses";
  return survey;
}

void takeKnown(const MissionInput& input, const std::vector<std::int64_t>& times, Survey& survey) {
  survey.known = knownAt(*input.nav_data, input.mission.origin, times);
  Anchor& anchor = survey.navigation.anchor;
  bool any = false;
  for (std::size_t k = 0; k < times.size(); ++k) {
    const KnownPose& one = survey.known[k];
    survey.navigation.poses[k].altitude = one.altitude;
    any = any || one.depth || one.heading || one.tilt || one.altitude || one.moved || one.north_east;
    if (!one.north_east) continue;
    anchor.source = "navigation file";
    anchor.sigma = one.sigma;
    ++anchor.fixes_used;
  }
  if (!any)
    throw InputError(input.paths.root.string(), "--nav",
                     "says nothing of the times when the images were taken (" + io::isoTime(times.front()) +
                         " to " + io::isoTime(times.back()) + "); check both clocks, or give --nav-offset");
}

Survey imagesAlone(const MissionInput& input, const TopsideConfig& config) {
  Survey survey;
  survey.list = pairsOf(input);
  std::vector<std::int64_t> times;
  for (const ImagePair& pair : survey.list.pairs) {
    survey.navigation.poses.push_back({pair.utc_ns, {}, {}, {}});
    times.push_back(pair.utc_ns);
  }
  if (input.nav_data) takeKnown(input, times, survey);
  survey.planes = scoutPlanes(input, config, survey.list);
  return survey;
}

Survey navigated(const MissionInput& input, const TopsideConfig& config) {
  Survey survey;
  survey.list =
      input.files ? pairsOf(input) : listPairs(input.paths, input.mission, config.pairing_tolerance);
  std::vector<std::int64_t> times;
  for (const ImagePair& pair : survey.list.pairs) times.push_back(pair.utc_ns);
  survey.navigation = navigate(input.paths, input.mission, config, times);
  return survey;
}

// Changes whenever the same inputs and settings give another result.
constexpr std::uint32_t kSurveyVersion = 11;

}  // namespace

void addPlane(Hasher& hasher, const std::optional<stereo::SeedPlane>& plane) {
  hasher.add(plane.has_value());
  if (plane) hasher.add(plane->normal.x(), plane->normal.y(), plane->normal.z(), plane->distance);
}

PairList pairsOf(const MissionInput& input) {
  constexpr std::int64_t kStepNs = 500'000'000;  // where nobody knows the times
  PairList list;
  list.from_file_names = true;
  for (const StereoFilePair& pair : input.files->pairs) {
    if (!pair.utc_ns && (input.navigated || input.nav_data))
      throw InputError(input.paths.root.string(), pair.left.generic_string(),
                       "has no time in its name, and navigation is by time; give --time-pattern, or --pairs "
                       "with a column utc");
    const auto untimed = static_cast<std::int64_t>(list.pairs.size()) * kStepNs;
    list.pairs.push_back(
        {pair.utc_ns.value_or(untimed), pair.left.generic_string(), pair.right.generic_string(), {}});
  }
  for (const StereoFiles::Alone& alone : input.files->alone)
    ++(alone.missing == "right" ? list.left_alone : list.right_alone);
  return list;
}

Digest surveyKey(const MissionInput& input, const TopsideConfig& config) {
  Hasher hasher;
  hasher.add("survey", kSurveyVersion, input.identity);
  addRig(hasher, input);
  addNavigationSettings(hasher, config);
  return hasher.finish();
}

Survey takeSurvey(const MissionInput& input, const TopsideConfig& config) {
  Survey survey = !input.navigated    ? imagesAlone(input, config)
                  : input.given_poses ? fromPoses(input)
                                      : navigated(input, config);
  takeColourImages(input.colour_cameras, input.paths.images(), config.pairing_tolerance, survey.list);
  if (!input.navigated) return survey;
  survey.planes = seedPlanes(input.mission, survey.navigation.poses, config.default_altitude);
  if (!seesBeside(input)) return survey;
  const SeedPlanes found = scoutPlanes(input, config, survey.list);
  for (std::size_t k = 0; k < found.size(); ++k)
    if (survey.planes[k]) survey.planes[k] = found[k];
  return survey;
}

bool seesBeside(const MissionInput& input) {
  constexpr double kBeside = 0.64;  // cosine of its axis from the vehicle's down
  const Eigen::Vector3d ahead = input.mission.T_body_cam.rotation() * Eigen::Vector3d::UnitZ();
  return !input.features_only && ahead.z() < kBeside;
}

}  // namespace fathom::topside
