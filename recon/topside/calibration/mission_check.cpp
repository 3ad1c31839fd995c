#include "recon/topside/calibration/mission_check.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>

#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/files/mission.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/progress.hpp"
#include "recon/lighting/rig_ranges.hpp"
#include "recon/topside/calibration/free_matches.hpp"
#include "recon/topside/calibration/range_map.hpp"
#include "recon/topside/input/image_pairs.hpp"
#include "recon/topside/input/navigation.hpp"
#include "recon/topside/input/seed_plane.hpp"
#include "recon/topside/light/lighting_stage.hpp"

namespace fathom::topside {
namespace {

constexpr std::size_t kRun = 12;                     // consecutive pairs looked at together
constexpr std::int64_t kDvlSpacing = 200'000'000;    // of the DVL's altitudes compared [ns]
constexpr double kBeamAngle = std::numbers::pi / 6;  // of a Janus DVL's beams off its axis

// All that a pair is looked at with.
struct Mission {
  io::MissionPaths paths;
  io::MissionConfig config;
  StereoRig rig;
  TopsideConfig topside;
  PairList list;
  Navigation navigation;          // poses: of the pairs, then of the DVL's altitudes
  std::vector<double> altitudes;  // of the pairs [m]
};

// The images of a pair, corrected for light, in 8 bit mono.
struct Seen {
  std::vector<std::uint8_t> left, right;
};

ImageView monoView(const std::vector<std::uint8_t>& pixels, const Camera& camera) {
  return {pixels.data(),      camera.width,
          camera.height,      static_cast<std::size_t>(camera.width),
          PixelFormat::kMono, 8};
}

std::vector<std::uint8_t> look(const Mission& m, const std::string& file, PixelFormat format,
                               const Camera& camera, const lighting::LightingModel& model,
                               const lighting::RangeLattice& ranges) {
  const io::ImageFile image =
      io::readImage(m.paths.images() / file, format, m.config.cameras.bits, camera.width, camera.height);
  const auto pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  const std::size_t samples = format == PixelFormat::kRgb ? 3 : 1;
  std::vector<std::uint8_t> corrected(pixels * samples), mono(pixels);
  model.correct(image.view, ranges, corrected.data());
  lighting::demosaicMono({corrected.data(), camera.width, camera.height,
                          static_cast<std::size_t>(camera.width) * samples, format, 8},
                         mono.data());
  return mono;
}

std::optional<Seen> lookAt(const Mission& m, const LightingModels& lighting, std::size_t pair,
                           const stereo::SeedPlane& plane, std::string& trouble) {
  lighting::RigRanges ranges(m.rig);
  ranges.fromPlane(plane.normal, plane.distance);
  const auto& cameras = m.config.cameras;
  try {
    return Seen{
        look(m, m.list.pairs[pair].left, cameras.left_format, m.rig.left, lighting.left, ranges.left()),
        look(m, m.list.pairs[pair].right, cameras.right_format, m.rig.right, lighting.right, ranges.right())};
  } catch (const InputError& error) {
    if (trouble.empty()) trouble = error.what();
    return std::nullopt;
  }
}

// What one run of pairs gives, in order.
struct RunResult {
  std::vector<calibration::RigMatch> matches;
  std::vector<std::pair<SE3, std::vector<SeenPoint>>> points;  // with T_nav_cam
  std::vector<calibration::MotionStep> steps;
  std::size_t pairs = 0, unreadable = 0;
  std::string trouble;  // of the first unreadable one
};

RunResult lookAtRun(const Mission& m, const LightingModels& lighting, std::size_t begin, std::size_t end) {
  RunResult out;
  std::optional<Seen> before;
  std::vector<SeenPoint> points_before;
  SE3 body_before;
  for (std::size_t k = begin; k < end; ++k) {
    const NavigatedPose& pose = m.navigation.poses[k];
    if (!pose.T_nav_body) {
      before.reset();
      continue;
    }
    const SE3& T_nav_body = *pose.T_nav_body;
    const stereo::SeedPlane plane = seedPlane(m.config, T_nav_body, m.altitudes[k]);
    std::optional<Seen> now = lookAt(m, lighting, k, plane, out.trouble);
    if (!now) {
      ++out.unreadable;
      before.reset();
      continue;
    }
    const bool shared = k == begin + kRun;  // the next run's first: here for the step to it alone
    if (!shared) ++out.pairs;
    const auto matches =
        matchFreely(m.rig, monoView(now->left, m.rig.left), monoView(now->right, m.rig.right), plane);
    std::vector<SeenPoint> points =
        triangulate(m.rig, matches, m.topside.stereo.min_range, m.topside.stereo.max_range);
    if (!shared) out.matches.insert(out.matches.end(), matches.begin(), matches.end());
    if (before) {
      const SE3 T_b1_b0 = T_nav_body.inverse() * body_before;
      const SE3& T_body_cam = m.config.T_body_cam;
      const auto motion =
          trackMotion(m.rig.left, monoView(before->left, m.rig.left), monoView(now->left, m.rig.left),
                      points_before, T_body_cam.inverse() * T_b1_b0 * T_body_cam);
      if (motion) out.steps.push_back({T_b1_b0, motion->R_c1_c0, motion->middle0, motion->middle1});
    }
    if (!shared) out.points.emplace_back(T_nav_body * m.config.T_body_cam, points);
    before = std::move(now);
    points_before = std::move(points);
    body_before = T_nav_body;
  }
  return out;
}

// Runs of kRun consecutive pairs, spread evenly so that there are about `wanted` pairs in all. Neighbouring
// runs share a pair, so that no step is lost where all are taken.
std::vector<std::pair<std::size_t, std::size_t>> runsOf(std::size_t pairs, std::size_t wanted) {
  std::vector<std::pair<std::size_t, std::size_t>> out;
  const std::size_t all = (pairs + kRun - 1) / kRun;
  const std::size_t count = std::clamp<std::size_t>((wanted + kRun - 1) / kRun, 1, all);
  for (std::size_t r = 0; r < count; ++r) {
    const std::size_t begin = r * all / count * kRun;
    out.emplace_back(begin, std::min(pairs, begin + kRun + 1));
  }
  return out;
}

// Where beams at these azimuths (about the DVL's axis, from forward) meet a level bottom, north and east [m].
std::vector<Eigen::Vector2d> footprints(const SE3& T_nav_dvl, double altitude, int beams,
                                        double first_azimuth) {
  std::vector<Eigen::Vector2d> out;
  for (int k = 0; k < beams; ++k) {
    const double azimuth = first_azimuth + 2 * std::numbers::pi * k / beams;
    const Eigen::Vector3d beam =
        T_nav_dvl.rotation() * Eigen::Vector3d(std::sin(kBeamAngle) * std::cos(azimuth),
                                               std::sin(kBeamAngle) * std::sin(azimuth),
                                               std::cos(kBeamAngle));
    out.emplace_back((T_nav_dvl.translation() + altitude / beam.z() * beam).head<2>());
  }
  return out;
}

// Where the altitude is taken to come from.
struct BeamPattern {
  const char* name;
  int beams;             // directions asked for
  double first_azimuth;  // [rad]
  int enough;            // directions that stereo must have seen
};
// A DVL looks along four beams, 45 degrees off the hull on most vehicles, straight ahead on some; a map of
// one line does not reach the outer ones, and the mean around the ring stands for them.
constexpr BeamPattern kPatterns[] = {{"four beams at 45 deg", 4, std::numbers::pi / 4, 4},
                                     {"four beams ahead, astern and abeam", 4, 0, 4},
                                     {"the ring that the beams lie on", 32, 0, 12}};

std::vector<calibration::RangeSample> compareRanges(const Mission& m, const RangeMap& map,
                                                    const BeamPattern& pattern) {
  std::vector<calibration::RangeSample> out;
  for (std::size_t k = m.list.pairs.size(); k < m.navigation.poses.size(); ++k) {
    const NavigatedPose& pose = m.navigation.poses[k];
    if (!pose.T_nav_body || !pose.altitude) continue;
    const SE3 T_nav_dvl = *pose.T_nav_body * m.config.T_body_dvl;
    const auto seen =
        map.at(footprints(T_nav_dvl, *pose.altitude, pattern.beams, pattern.first_azimuth), pattern.enough);
    if (!seen) continue;
    // Where stereo sees the bottom too deep, its ranges are too long by as much.
    const double too_deep = seen->depth - (T_nav_dvl.translation().z() + *pose.altitude);
    out.push_back({seen->range, seen->range - too_deep});
  }
  return out;
}

// The pattern that scatters least is the one that the DVL has, or that stereo saw enough of.
void compareRanges(const Mission& m, const RangeMap& map, MissionCheck& out) {
  constexpr std::size_t kEnough = 40;  // samples, to be preferred
  for (const BeamPattern& pattern : kPatterns) {
    std::vector<calibration::RangeSample> samples = compareRanges(m, map, pattern);
    const calibration::RangeCheck range = calibration::checkRanges(samples);
    const bool more = samples.size() >= kEnough && out.range_samples.size() < kEnough;
    const bool as_many = (samples.size() >= kEnough) == (out.range_samples.size() >= kEnough);
    const bool better = samples.size() >= kEnough ? range.scatter < out.range.scatter
                                                  : samples.size() > out.range_samples.size();
    if (!more && !(as_many && better)) continue;
    out.range_samples = std::move(samples);
    out.range = range;
    out.beams = pattern.name;
  }
}

Mission readMission(const MissionCheckOptions& options) {
  Mission m{io::MissionPaths(options.mission), io::readMissionConfig(options.mission), {}, {}, {}, {}, {}};
  m.rig = readStereoCalib(options.calib.empty() ? m.paths.calib() : options.calib);
  // A rig that sees ranges a third too long must not lose its points.
  m.topside.stereo.max_range *= 1.5;
  m.list = listPairs(m.paths, m.config, m.topside.pairing_tolerance);
  if (m.list.features_only)
    throw InputError(options.mission.string(), "features",
                     "a mission without images has none to check the calibration by; give one with img/");
  std::vector<std::int64_t> times, dvl_times;
  for (const ImagePair& pair : m.list.pairs) times.push_back(pair.utc_ns);
  m.navigation = navigate(m.paths, m.config, m.topside, times);
  m.altitudes = seedAltitudes(m.navigation.poses, m.topside.default_altitude);
  for (std::int64_t t = times.front(); t <= times.back(); t += kDvlSpacing) dvl_times.push_back(t);
  const Navigation between = navigate(m.paths, m.config, m.topside, dvl_times);
  m.navigation.poses.insert(m.navigation.poses.end(), between.poses.begin(), between.poses.end());
  return m;
}

}  // namespace

MissionCheck checkMission(const MissionCheckOptions& options) {
  const Mission m = readMission(options);
  const std::vector<NavigatedPose> pair_poses(
      m.navigation.poses.begin(),
      m.navigation.poses.begin() + static_cast<std::ptrdiff_t>(m.list.pairs.size()));
  LightingModels lighting(m.config, m.rig, m.topside.lighting);
  learnLighting(m.paths, m.config, m.rig, m.list.pairs, pair_poses, m.topside, lighting);
  const auto runs = runsOf(m.list.pairs.size(), options.pairs);
  std::vector<RunResult> results(runs.size());
  {
    rt::StageProgress progress("matching", runs.size());
    oneapi::tbb::parallel_for(std::size_t{0}, runs.size(), [&](std::size_t r) {
      results[r] = lookAtRun(m, lighting, runs[r].first, runs[r].second);
      progress.step();
    });
  }

  MissionCheck out;
  out.mission = options.mission.string();
  out.port = m.config.water.refractive_port;
  out.left = m.rig.left;
  out.T_body_cam = m.config.T_body_cam;
  std::vector<calibration::RigMatch> matches;
  std::vector<calibration::MotionStep> steps;
  RangeMap map;
  for (const RunResult& r : results) {
    out.pairs += r.pairs;
    out.unreadable += r.unreadable;
    matches.insert(matches.end(), r.matches.begin(), r.matches.end());
    steps.insert(steps.end(), r.steps.begin(), r.steps.end());
    for (const auto& [T_nav_cam, points] : r.points) map.add(T_nav_cam, points);
  }
  out.matches = matches.size();
  constexpr std::size_t kFewest = 100;  // matches in all
  if (matches.size() < kFewest) {
    std::string why = std::to_string(matches.size()) + " matches between left and right in " +
                      std::to_string(out.pairs) + " pairs are too few to judge the rig";
    for (const RunResult& r : results)
      if (!r.trouble.empty())
        throw InputError(options.mission.string(), "img", why + "; unreadable: " + r.trouble);
    throw InputError(options.mission.string(), "img", why + "; are these images of one scene?");
  }
  out.epipolar = checkEpipolar(m.rig, matches);
  compareRanges(m, map, out);
  out.mount = alignMount(steps, m.config.T_body_cam);
  return out;
}

}  // namespace fathom::topside
