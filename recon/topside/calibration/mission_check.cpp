#include "recon/topside/calibration/mission_check.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>

#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/topside/calibration/free_matches.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/light/lighting_stage.hpp"
#include "recon/topside/light/pair_images.hpp"

namespace fathom::topside {

std::pair<std::int64_t, std::int64_t> RangeMap::cellOf(double north, double east) {
  return {static_cast<std::int64_t>(std::floor(north / kCell)),
          static_cast<std::int64_t>(std::floor(east / kCell))};
}

void RangeMap::add(const SE3& T_nav_cam, const std::vector<SeenPoint>& points) {
  for (const SeenPoint& p : points) {
    const Eigen::Vector3d in_nav = T_nav_cam * p.point;
    Cell& cell = cells_[cellOf(in_nav.x(), in_nav.y())];
    cell.depth += in_nav.z();
    cell.range += in_nav.z() - T_nav_cam.translation().z();
    ++cell.points;
  }
}

std::optional<RangeMap::Seen> RangeMap::at(const std::vector<Eigen::Vector2d>& places, int enough) const {
  Seen sum;
  int found = 0;
  for (const Eigen::Vector2d& place : places) {
    const auto [north, east] = cellOf(place.x(), place.y());
    Seen here;
    int cells = 0;
    for (std::int64_t n = north - 1; n <= north + 1; ++n)
      for (std::int64_t e = east - 1; e <= east + 1; ++e) {
        const auto cell = cells_.find({n, e});
        if (cell == cells_.end()) continue;
        here.depth += cell->second.depth / cell->second.points;
        here.range += cell->second.range / cell->second.points;
        ++cells;
      }
    constexpr int kEnoughCells = 3;  // of nine
    if (cells < kEnoughCells) continue;
    sum.depth += here.depth / cells;
    sum.range += here.range / cells;
    ++found;
  }
  if (found < enough) return std::nullopt;
  return Seen{sum.depth / found, sum.range / found};
}

namespace {

constexpr std::size_t kRun = 12;                     // consecutive pairs looked at together
constexpr std::int64_t kDvlSpacing = 200'000'000;    // of the DVL's altitudes compared [ns]
constexpr double kBeamAngle = std::numbers::pi / 6;  // of a Janus DVL's beams off its axis

// All that a pair is looked at with.
struct Mission {
  MissionInput input;
  TopsideConfig topside;
  Survey survey;
  std::vector<NavigatedPose> between;  // at the DVL's altitudes
};

// What one run of pairs gives, in order.
struct RunResult {
  std::vector<RigMatch> matches;
  std::vector<std::pair<SE3, std::vector<SeenPoint>>> points;  // with T_nav_cam
  std::vector<calibration::MotionStep> steps;
  std::size_t pairs = 0, unreadable = 0;
  std::string trouble;  // of the first unreadable one
};

RunResult lookAtRun(const Mission& m, const LightingModels& lighting, std::size_t begin, std::size_t end) {
  RunResult out;
  PairImages images(m.input, lighting);
  std::vector<std::uint8_t> before;  // the left image
  std::vector<SeenPoint> points_before;
  SE3 body_before;
  for (std::size_t k = begin; k < end; ++k) {
    const NavigatedPose& pose = m.survey.navigation.poses[k];
    if (!pose.T_nav_body) {
      before.clear();
      continue;
    }
    const SE3& T_nav_body = *pose.T_nav_body;
    const stereo::SeedPlane plane = *m.survey.planes[k];
    if (!images.read(m.survey.list.pairs[k])) {
      if (out.trouble.empty()) out.trouble = images.error();
      ++out.unreadable;
      before.clear();
      continue;
    }
    images.correct(plane);
    const bool shared = k == begin + kRun;  // the next run's first: here for the step to it alone
    if (!shared) ++out.pairs;
    const auto matches = matchFreely(m.input.rig, images.left(), images.right(), plane);
    std::vector<SeenPoint> points =
        triangulate(m.input.rig, matches, m.topside.stereo.min_range, m.topside.stereo.max_range);
    if (!shared) out.matches.insert(out.matches.end(), matches.begin(), matches.end());
    if (!before.empty()) {
      const SE3 T_b1_b0 = T_nav_body.inverse() * body_before;
      const SE3& T_body_cam = m.input.mission.T_body_cam;
      const auto motion =
          trackMotion(m.input.rig.left, eightBitView(before, m.input.rig.left, PixelFormat::kMono),
                      images.left(), points_before, T_body_cam.inverse() * T_b1_b0 * T_body_cam);
      if (motion) out.steps.push_back({T_b1_b0, motion->R_c1_c0, motion->middle0, motion->middle1});
    }
    if (!shared) out.points.emplace_back(T_nav_body * m.input.mission.T_body_cam, points);
    const auto* left = static_cast<const std::uint8_t*>(images.left().data);
    before.assign(left, left + pixelsOf(m.input.rig.left));
    points_before = std::move(points);
    body_before = T_nav_body;
  }
  return out;
}

// Runs of kRun consecutive pairs, spread evenly so that there are about `wanted` pairs in all. Neighbouring
// runs share a pair, so that no step is lost where all are taken.
std::vector<std::pair<std::size_t, std::size_t>> pairRunsOf(std::size_t pairs, std::size_t wanted) {
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
                                     {"the ring that the beams are on", 32, 0, 12}};

std::vector<calibration::RangeSample> compareRanges(const Mission& m, const RangeMap& map,
                                                    const BeamPattern& pattern) {
  std::vector<calibration::RangeSample> out;
  for (const NavigatedPose& pose : m.between) {
    if (!pose.T_nav_body || !pose.altitude) continue;
    const SE3 T_nav_dvl = *pose.T_nav_body * m.input.mission.T_body_dvl;
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
  Mission m;
  // A rig that sees ranges a third too long must not lose its points.
  m.topside.stereo.max_range *= 1.5;
  m.input = openMission(options.mission, {.calib = options.calib, .calib_unit = options.calib_unit});
  if (m.input.features_only)
    throw InputError(options.mission.string(), "features",
                     "a mission without images has none to check the calibration by; give one with img/");
  m.survey = takeSurvey(m.input, m.topside);
  const std::vector<ImagePair>& pairs = m.survey.list.pairs;
  std::vector<std::int64_t> dvl_times;
  for (std::int64_t t = pairs.front().utc_ns; t <= pairs.back().utc_ns; t += kDvlSpacing)
    dvl_times.push_back(t);
  m.between = navigate(m.input.paths, m.input.mission, m.topside, dvl_times).poses;
  return m;
}

}  // namespace

MissionCheck checkMission(const MissionCheckOptions& options) {
  const Mission m = readMission(options);
  LightingModels lighting(m.input, m.topside.lighting);
  learnLighting(m.input, m.topside, m.survey, lighting);
  const auto runs = pairRunsOf(m.survey.list.pairs.size(), options.pairs);
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
  out.port = m.input.mission.water.refractive_port;
  out.rig = m.input.rig;
  out.T_body_cam = m.input.mission.T_body_cam;
  std::vector<RigMatch> matches;
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
  out.epipolar = calibration::checkEpipolar(m.input.rig, matches);
  compareRanges(m, map, out);
  out.mount = alignMount(steps, m.input.mission.T_body_cam);
  return out;
}

}  // namespace fathom::topside
