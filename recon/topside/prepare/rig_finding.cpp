#include "recon/topside/prepare/rig_finding.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "firmware_if/mission/feature_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/text.hpp"
#include "recon/calibration/sensor_checks.hpp"
#include "recon/closure/registration.hpp"
#include "recon/topside/calibration/free_matches.hpp"
#include "recon/topside/light/pair_images.hpp"
#include "recon/topside/localise/first_links.hpp"
#include "recon/topside/prepare/pair_preparer.hpp"

namespace fathom::topside {

namespace {

std::vector<RigMatch> rigMatchesOf(const MissionInput& input, const Survey& survey,
                                   const LightingModels& models, std::size_t pair) {
  const ImagePair& names = survey.list.pairs[pair];
  std::vector<RigMatch> matches;
  if (input.features_only) {
    StereoFeatureFrame frame;
    try {
      io::readFeatureFile(input.paths.features() / io::featureFileName(names.left), frame);
    } catch (const InputError&) {
      return matches;  // the pair's preparation reports it
    }
    for (const StereoFeature& f : frame.features)
      matches.push_back({f.left.cast<double>(), f.right.cast<double>()});
    return matches;
  }
  PairImages images(input, models);
  if (!images.read(names)) return matches;
  images.correct(*survey.planes[pair]);
  return matchFreely(input.rig, images.left(), images.right(), *survey.planes[pair]);
}

std::vector<RigMatch> matchesOfDive(const MissionInput& input, const Survey& survey,
                                    const LightingModels& models, std::size_t wanted) {
  std::vector<std::size_t> known;
  for (std::size_t k = 0; k < survey.list.pairs.size(); ++k)
    if (survey.planes[k]) known.push_back(k);
  const std::size_t count = std::min(known.size(), wanted);
  std::vector<std::vector<RigMatch>> found(count);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    found[k] = rigMatchesOf(input, survey, models, known[k * known.size() / count]);
  });
  std::vector<RigMatch> matches;
  for (const auto& some : found) matches.insert(matches.end(), some.begin(), some.end());
  return matches;
}

// What is left of the rig's change after what was found so far, into what was found.
void addChange(const calibration::EpipolarCheck& check, RigFinding& out) {
  Vector6d more = Vector6d::Zero(), before = more;
  more.tail<3>() = check.change.rotation;
  before.tail<3>() = out.change.rotation;
  out.change.rotation = (SE3::exp(more) * SE3::exp(before)).log().tail<3>();
  out.change.focal += check.change.focal;
  out.change.radial += check.change.radial;
  out.after = check.sigma_after;
  constexpr double kShared = 2;  // neighbouring matches share errors
  out.yaw_sigma = kShared * check.change_sigma.rotation.y();
}

// Two pairs with a path between them that dead reckoning knows well.
struct Step {
  std::size_t a = 0, b = 0;
  SE3 T_nav_a, T_nav_b;  // of the cameras, as reckoned
  slam::StepQuality quality;
};

// Which they are: at least a share of the range long, with more than half of the ground in common, and with a
// turn of at most so much [rad].
struct StepRule {
  double share, most_turn;
};
constexpr StepRule kLongSteps{0.25, 0.1};  // they measure best
constexpr StepRule kAnySteps{0.12, 0.4};   // of a dive that turns all the time, or is short

// One after the other, so that a reading of roll and pitch which ends one begins the next.
std::vector<Step> stepsBy(const StepRule& rule, const MissionInput& input, const Survey& survey) {
  constexpr std::size_t kWithin = 6;  // pairs
  std::vector<Step> steps;
  const std::vector<NavigatedPose>& poses = survey.navigation.poses;
  for (std::size_t a = 0, next = 0; a < poses.size(); a = next) {
    next = a + 1;
    if (!poses[a].T_nav_body || !survey.planes[a]) continue;
    for (std::size_t b = a + 1; b < std::min(poses.size(), a + kWithin); ++b) {
      if (!poses[b].T_nav_body || !survey.planes[b]) break;
      const nav::DeadReckoning::Quality &before = poses[a].quality, &now = poses[b].quality;
      if (now.unlocked_s > before.unlocked_s || now.untilted_s > before.untilted_s || now.attitude_held ||
          now.depth_held || now.heading_leaps > before.heading_leaps)
        break;
      Step step{a,
                b,
                *poses[a].T_nav_body * input.mission.T_body_cam,
                *poses[b].T_nav_body * input.mission.T_body_cam,
                {}};
      const SE3 between = step.T_nav_a.inverse() * step.T_nav_b;
      if (between.translation().norm() < rule.share * survey.planes[a]->ahead()) continue;
      step.quality.seconds = static_cast<double>(poses[b].utc_ns - poses[a].utc_ns) * 1e-9;
      step.quality.turn = between.rotation().angularDistance(Eigen::Quaterniond::Identity());
      if (step.quality.turn < rule.most_turn) steps.push_back(step);
      next = b;
      break;
    }
  }
  return steps;
}

// Steps that follow each other.
struct Run {
  std::size_t first = 0, end = 0;
};

// Spread over all steps: how the rig turns what it sees shows against roll and pitch over a run's length.
std::vector<Run> stepRunsOf(std::size_t steps) {
  constexpr std::size_t kOfRun = 20;
  const std::size_t wanted = std::clamp(steps / kRigShare, kLeastRigSteps, kMostRigSteps),
                    runs = (std::min(steps, wanted) + kOfRun - 1) / kOfRun;
  std::vector<Run> out;
  for (std::size_t r = 0; r < runs; ++r) {
    const std::size_t first = r * steps / runs;
    out.push_back({first, std::min(first + kOfRun, (r + 1) * steps / runs)});
  }
  return out;
}

// Between both cameras' principal points along the baseline [rad]: matches are off their epipolar lines by
// what is wrong across it, and what is wrong along it, which they do not show, is not better known.
double principalPointSigma(const StereoRig& rig, const RigFinding& found) {
  constexpr double kAlong = 0.5;  // of what is wrong across (combined disturbances, 18 simulated dives)
  return hypotenuse(slam::RigPrior().principal_point, kAlong * found.before / rig.left.fx);
}

double rangeOf(const closure::FrameFeatures& features) {
  std::vector<double> z;
  for (const closure::Feature& f : features.features) z.push_back(static_cast<double>(f.point.z()));
  return median(std::move(z));
}

struct SeenStep {
  double range = 0;  // 0: no features
  closure::Registration link;
  CameraOverDvl longer;
};

SeenStep seenStep(const Step& step, const Survey& survey, double range, const closure::Registration& link,
                  const Eigen::Vector3d& dvl_in_camera) {
  const auto pathOf = [&](const SE3& T_a_b) { return (T_a_b * dvl_in_camera - dvl_in_camera).norm(); };
  return {range,
          link,
          {std::log(pathOf(link.T_a_b) / pathOf(step.T_nav_a.inverse() * step.T_nav_b)),
           std::log(range / survey.planes[step.b]->ahead())}};
}

// By how much ranges are too long by both of the DVL's measurements, paths and altitudes: by that which says
// less, 0 where they contradict each other. Less than relief makes of altitudes, and the sound speed of other
// water of both, is none.
double tooLongByBoth(const std::vector<SeenStep>& seen) {
  constexpr double kLeast = 0.05;  // of the range
  std::vector<double> by_path, by_altitude;
  for (const SeenStep& one : seen) {
    if (!one.link.accepted()) continue;
    by_path.push_back(one.longer.path);
    by_altitude.push_back(one.longer.altitude);
  }
  const double path = median(std::move(by_path)), altitude = median(std::move(by_altitude));
  const double both = std::min(std::abs(path), std::abs(altitude));
  return path * altitude > 0 && both >= kLeast ? both : 0;
}

// A DVL may be noisier than it should: it counts as noisy as most steps show. By a smaller noise the few
// steps that agree by chance would be all that count.
slam::DvlCalibration calibrationByMost(const std::vector<Step>& steps, const std::vector<SeenStep>& seen,
                                       slam::SensorNoise noise, const Eigen::Vector3d& dvl_in_camera,
                                       const slam::RigPrior& prior, double sound_share) {
  constexpr std::ptrdiff_t kMost = 4, kOf = 5;
  constexpr int kDoublings = 6;
  for (int doubling = 0;; ++doubling, noise.dvl_velocity *= 2) {
    slam::DvlCalibration out(noise, dvl_in_camera, prior);
    out.setSoundShare(sound_share);
    std::ptrdiff_t tried = 0, agreed = 0;
    for (std::size_t k = 0; k < steps.size(); ++k) {
      const closure::Registration& link = seen[k].link;
      if (!link.accepted()) continue;
      ++tried;
      if (out.add(steps[k].T_nav_a, steps[k].T_nav_b, link.T_a_b, link.covariance, steps[k].quality,
                  seen[k].range))
        ++agreed;
    }
    if (kOf * agreed >= kMost * tried || doubling == kDoublings) return out;
  }
}

// What paths say of the range error that is left of the rig as it was found so far, into what was found;
// false when chance explains it.
bool addRange(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
              const LightingModels& models, RigFinding& out) {
  MissionInput turned = input;
  turned.rig = rigAsFound(input.rig, out);
  constexpr std::size_t kEnough = 20;
  std::vector<Step> all = stepsBy(kLongSteps, turned, survey);
  const bool few_long = all.size() < kEnough;
  if (few_long) all = stepsBy(kAnySteps, turned, survey);
  const std::vector<Run> runs = stepRunsOf(all.size());
  const Eigen::Vector3d dvl_in_camera =
      input.mission.T_body_cam.inverse() * input.mission.T_body_dvl.translation();
  std::vector<SeenStep> seen(all.size());
  oneapi::tbb::parallel_for(std::size_t{0}, runs.size(), [&](std::size_t r) {
    const auto preparer = makePreparer(turned, config, models, true);
    const auto prepare = [&](std::size_t pair) {
      return preparer->process(survey.list.pairs[pair], *survey.planes[pair]).features;
    };
    closure::Registrar registrar(turned.rig, stepRules());
    closure::FrameFeatures a, b;
    for (std::size_t k = runs[r].first; k < runs[r].end; ++k) {
      const Step& step = all[k];
      const bool goes_on = k > runs[r].first && step.a == all[k - 1].b;
      a = goes_on ? std::move(b) : prepare(step.a);
      b = prepare(step.b);
      const closure::Registration& link =
          registrar.process(a, b, stepPrior(step.T_nav_a.inverse() * step.T_nav_b));
      seen[k] = seenStep(step, survey, rangeOf(b), link, dvl_in_camera);
    }
  });
  std::vector<CameraOverDvl> longer;
  for (const SeenStep& one : seen) longer.push_back(one.longer);
  const std::vector<bool> of_seafloor = areOfSeafloor(longer);
  for (std::size_t k = 0; k < seen.size(); ++k)
    if (!of_seafloor[k]) seen[k].link.refusal = closure::Refusal::kContradiction;
  slam::RigPrior prior = config.navigation.rig;
  prior.baseline = turned.rig.baseline();
  prior.turn = out.yaw_sigma;
  prior.principal_point = principalPointSigma(input.rig, out);
  std::vector<double> ranges;
  for (const SeenStep& one : seen)
    if (one.link.accepted()) ranges.push_back(one.range);
  // A few paths of a dive that turns all the time, or is short, say little, and nothing of their own errors.
  constexpr std::size_t kFewest = 8, kFewestOfBoth = 3;
  const double by_both = tooLongByBoth(seen);
  if (ranges.size() < (by_both > 0 || out.steps > 0 ? kFewestOfBoth : kFewest)) return false;
  const std::size_t paths = ranges.size();
  const double range = median(std::move(ranges));
  prior.principal_point = hypotenuse(prior.principal_point, by_both * turned.rig.baseline() / range);
  const slam::DvlCalibration by_steps =
      calibrationByMost(all, seen, config.navigation.noise, dvl_in_camera, prior,
                        survey.navigation.poses[all.front().a].quality.sound_share);
  // Where short paths know little, all of them together know the scale alone better (imageScaleOf()).
  constexpr double kWorthKnowing = 0.01;
  const double sigma = by_steps.rangeSigma(range);
  if (few_long && by_both == 0 && sigma > kWorthKnowing) return false;
  out.steps = paths, out.usual_range = range, out.range_sigma = sigma;
  const calibration::RangeError left{by_steps.rangeError().x(), by_steps.rangeError().y()};
  out.range.scale += left.scale;
  out.range.per_metre += left.per_metre;
  constexpr double kBeyondChance = 3;  // standard deviations
  return std::abs(left.at(range)) > kBeyondChance * out.range_sigma;
}

}  // namespace

std::vector<bool> areOfSeafloor(std::span<const CameraOverDvl> steps) {
  constexpr double kMost = 0.25;  // logarithm
  std::vector<double> altitudes;
  for (const CameraOverDvl& step : steps)
    if (std::isfinite(step.altitude)) altitudes.push_back(step.altitude);
  const double usual = median(std::move(altitudes));
  std::vector<bool> out;
  for (const CameraOverDvl& step : steps)
    out.push_back(std::abs(step.path - step.altitude) < kMost && std::abs(step.altitude - usual) < kMost);
  return out;
}

// In turns: epipolar lines take a part of a wrong principal point for a turn, as lenses that distort let it
// seem one.
RigFinding findRig(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                   const LightingModels& models) {
  constexpr int kRounds = 4;
  std::vector<RigMatch> matches = matchesOfDive(input, survey, models, kRigPairs);
  calibration::EpipolarCheck check = calibration::checkEpipolar(input.rig, matches);
  if (calibration::explainsMove(check)) {
    matches = matchesOfDive(input, survey, models, kMovedRigPairs);
    check = calibration::checkEpipolar(input.rig, matches);
  }
  RigFinding out;
  out.matches = matches.size();
  out.before = check.worst();
  out.after = check.sigma_after;
  out.moved = calibration::explainsMove(check);
  for (int round = 0; round < kRounds; ++round) {
    if (calibration::measuresRig(check)) addChange(check, out);
    if (!input.navigated || !addRange(input, config, survey, models, out)) break;
    check = calibration::checkEpipolar(rigAsFound(input.rig, out), matches);
  }
  return out;
}

StereoRig rigAsFound(const StereoRig& rig, const RigFinding& found) {
  return calibration::withoutRangeError(calibration::changed(rig, found.change), found.range);
}

slam::RigPrior rigPrior(const StereoRig& rig, const RigFinding& found) {
  // Where a rig was wrong, so is what its lenses distort; a turn takes out most of it (combined disturbances,
  // 60 simulated dives).
  constexpr double kLeft = 0.012;  // of what was found
  constexpr double kLeast = 0.01;  // of any rig [px]
  slam::RigPrior prior;
  prior.baseline = rig.baseline();
  prior.uneven = hypotenuse(kLeast, kLeft * found.before);
  prior.turn = found.yaw_sigma;
  prior.principal_point = principalPointSigma(rig, found);
  if (found.steps == 0) return prior;
  prior.scale = found.range_sigma;
  prior.principal_point = prior.turn = 0;
  return prior;
}

std::optional<std::string> warningOf(const RigFinding& found) {
  constexpr double kWorthSaying = 0.03;
  const double longer = found.range.at(found.usual_range);
  std::string out;
  if (found.moved)
    out = "The rig does not stand as it was calibrated: matches are up to " + decimals(found.before, 1) +
          " px off their epipolar lines. This run takes " + calibration::describeChange(found.change) +
          ", which leaves " + decimals(found.after, 2) + " px a match. ";
  if (std::abs(longer) > kWorthSaying)
    out += "Ranges by the cameras are " + decimals(100 * std::abs(longer), 1) + " percent too " +
           (longer > 0 ? "long" : "short") + " by what the DVL measures, and are corrected in this run. ";
  if (out.empty()) return std::nullopt;
  return out + "Calibrate again.";
}

}  // namespace fathom::topside
