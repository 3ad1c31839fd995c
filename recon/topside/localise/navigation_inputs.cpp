#include "recon/topside/localise/navigation_inputs.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/numbers/union_find.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/sea_water.hpp"
#include "recon/navigation/graph/navigation_config.hpp"
#include "recon/navigation/sensors/mounting_check.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"

namespace fathom::topside {

std::vector<slam::KeyframeInput> inputsOf(const Frames& frames, const Navigation& navigation) {
  std::vector<slam::KeyframeInput> inputs;
  slam::LossOfTrack loss;
  for (std::size_t k = 0; k < frames.pair.size(); ++k) {
    const NavigatedPose& pose = navigation.poses[frames.pair[k]];
    const NavigatedPose& last = navigation.poses[frames.pair[k == 0 ? 0 : k - 1]];
    auto input = slam::KeyframeInput::between(last.quality, pose.quality);
    input.utc_ns = pose.utc_ns;
    input.T_odom_cam = frames.reckoned[k];
    const bool of_ground = !frames.false_bottom[k] && (k == 0 || !frames.false_bottom[k - 1]);
    input.unlocked_s = loss.add(of_ground ? pose.quality.unlocked_s - last.quality.unlocked_s
                                          : rt::seconds(pose.utc_ns - last.utc_ns));
    inputs.push_back(input);
  }
  return inputs;
}

std::vector<slam::NavigationFix> fixesOf(const Frames& frames, const Navigation& navigation,
                                         const slam::SensorNoise& noise) {
  std::vector<slam::NavigationFix> fixes;
  slam::UsblWander wander;
  for (const FixSeen& seen : navigation.fixes) {
    const bool before = seen.utc_ns < navigation.poses[frames.pair.front()].utc_ns;
    if (seen.kind == nav::FixKind::kGps && before) continue;
    const auto later = std::lower_bound(
        frames.pair.begin(), frames.pair.end(), seen.utc_ns,
        [&](std::uint32_t pair, std::int64_t t) { return navigation.poses[pair].utc_ns < t; });
    std::size_t k = static_cast<std::size_t>(later - frames.pair.begin());
    if (k == frames.pair.size() || (k > 0 && seen.utc_ns - navigation.poses[frames.pair[k - 1]].utc_ns <
                                                 navigation.poses[frames.pair[k]].utc_ns - seen.utc_ns))
      --k;
    slam::NavigationFix fix;
    fix.frame = static_cast<int>(k);
    fix.antenna_in_odom = seen.receiver;
    fix.north_east = seen.north_east;
    fix.by_usbl = seen.kind == nav::FixKind::kUsbl;
    fix.sigma = fix.by_usbl ? wander.add(seen.utc_ns, seen.sigma, noise) : seen.sigma;
    fixes.push_back(fix);
  }
  return fixes;
}

slam::NavigationConfig graphOf(const io::MissionConfig& mission, slam::NavigationConfig graph) {
  graph.noise = slam::withTide(graph.noise, readTide(mission.tide_model, mission.start_utc_ns).has_value());
  graph.dvl_in_camera = mission.T_body_cam.inverse() * mission.T_body_dvl.translation();
  graph.forward_in_camera = mission.T_body_cam.rotation().conjugate() * Eigen::Vector3d::UnitX();
  return graph;
}

void bridge(std::vector<slam::KeyframeInput>& inputs, std::vector<slam::NavigationFix>& fixes,
            const std::vector<slam::NavigationLink>& links, double unknown_velocity) {
  const std::size_t frames = inputs.size();
  std::vector<std::optional<Eigen::Vector3d>> velocity(frames);  // in the camera, over the step to each frame
  const auto seconds = [&](std::size_t k) { return rt::seconds(inputs[k].utc_ns - inputs[k - 1].utc_ns); };
  const auto middle = [&](std::size_t k) {
    return 0.5 * rt::seconds(inputs[k].utc_ns + inputs[k - 1].utc_ns);
  };
  for (const slam::NavigationLink& link : links)
    if (link.kept && link.ofChain() && seconds(link.b) > 0)
      velocity[link.b] = link.T_a_b.translation() / seconds(link.b);
  std::vector<Eigen::Vector3d> moved(frames, Eigen::Vector3d::Zero());
  for (std::size_t k = 1; k < frames; ++k) {
    moved[k] = moved[k - 1];
    if (velocity[k] || inputs[k].unlocked_s == 0) continue;
    std::size_t before = k, after = k;
    while (before > 0 && !velocity[before]) --before;
    while (after < frames && !velocity[after]) ++after;
    double weights = 0;
    Eigen::Vector3d seen = Eigen::Vector3d::Zero();
    for (const std::size_t other : {before, after}) {
      if (other == 0 || other == frames) continue;
      const double weight = 1 / std::abs(middle(other) - middle(k));
      seen += weight * *velocity[other];
      weights += weight;
    }
    if (weights == 0) continue;
    const double unlocked_s = slam::kMostAcceleration * seconds(k) / weights / unknown_velocity;
    if (unlocked_s >= inputs[k].unlocked_s) continue;
    const SE3 &from = inputs[k - 1].T_odom_cam, &to = inputs[k].T_odom_cam;
    Eigen::Vector3d change =
        from.rotation() * seen * (seconds(k) / weights) - (to.translation() - from.translation());
    change.z() = 0;  // depth is measured
    moved[k] += change;
    inputs[k].unlocked_s = unlocked_s;
  }
  for (std::size_t k = 0; k < frames; ++k)
    inputs[k].T_odom_cam =
        SE3(inputs[k].T_odom_cam.rotation(), inputs[k].T_odom_cam.translation() + moved[k]);
  for (slam::NavigationFix& fix : fixes) fix.antenna_in_odom += moved[static_cast<std::size_t>(fix.frame)];
}

std::vector<std::uint32_t> unjoined(const std::vector<slam::KeyframeInput>& inputs,
                                    const std::vector<slam::NavigationLink>& links, double unknown_velocity) {
  constexpr std::size_t kFew = 8;
  constexpr double kKnown = 0.1;  // standard deviation of a step [m]
  const auto frames = static_cast<std::uint32_t>(inputs.size());
  UnionFind joined(frames);
  for (const slam::NavigationLink& link : links)
    if (link.kept) joined.join(link.a, link.b);
  for (std::uint32_t k = 1; k < frames; ++k)
    if (unknown_velocity * inputs[k].unlocked_s <= kKnown) joined.join(k - 1, k);
  std::vector<std::size_t> size(frames, 0);
  for (std::uint32_t k = 0; k < frames; ++k) ++size[joined.root(k)];
  const std::size_t most = *std::max_element(size.begin(), size.end());
  std::vector<std::uint32_t> out;
  for (std::uint32_t k = 0; k < frames; ++k)
    if (const std::size_t mine = size[joined.root(k)]; mine < most && mine < kFew) out.push_back(k);
  return out;
}

namespace {

Navigation navigationBy(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                        const SensorTiming& timing) {
  std::vector<std::int64_t> taken;
  for (const NavigatedPose& pose : survey.navigation.poses)
    taken.push_back(pose.utc_ns + rt::nanoseconds(timing.images_late));
  Navigation out = navigate(input.paths, input.mission, config, taken, timing.attitude_late);
  for (std::size_t k = 0; k < out.poses.size(); ++k) out.poses[k].utc_ns = survey.navigation.poses[k].utc_ns;
  return out;
}

std::ptrdiff_t posesKnown(const Navigation& navigation) {
  return std::count_if(navigation.poses.begin(), navigation.poses.end(),
                       [](const NavigatedPose& pose) { return pose.T_nav_body.has_value(); });
}

}  // namespace

std::optional<Retimed> retimed(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                               const FeatureStore& features, const std::vector<slam::NavigationLink>& links) {
  constexpr double kSigmas = 4, kLeast = 0.05, kMost = 3;  // of an offset that counts [s]
  constexpr double kDecisive = 4;                          // of Cauchy's cost of all steps
  constexpr int kRounds = 3;                               // a long lag shows too small at first
  const auto mountingBy = [&](const Navigation& navigation) {
    Survey with;
    with.planes = survey.planes;
    with.navigation = navigation;
    const Frames frames = framesOf(input.mission, with, features);
    return slam::mountingOf(inputsOf(frames, navigation), links, config.navigation.noise);
  };
  const slam::Mounting given = mountingBy(survey.navigation);
  std::optional<Retimed> best;
  if (std::abs(given.time_offset) < std::max(kLeast, kSigmas * given.time_offset_sigma)) return best;
  // A shift that is right does at least half of what the offset promises, which is of first order alone.
  double least = 0.5 * (given.misfit + given.misfit_unshifted);
  for (double SensorTiming::*const what : {&SensorTiming::attitude_late, &SensorTiming::images_late}) {
    // A compass filters its readings, which makes them late; images have a trigger's stamps, and are off
    // beyond doubt or not.
    if (best && best->timing.attitude_late > 0) least -= kDecisive / given.steps;
    slam::Mounting seen = given;
    SensorTiming timing;
    for (int round = 0; round < kRounds; ++round) {
      timing.*what = std::clamp(timing.*what + seen.time_offset, -kMost, kMost);
      Navigation navigation = navigationBy(input, config, survey, timing);
      // A shift must not cost frames at either end their pose: links name frames.
      if (posesKnown(navigation) != posesKnown(survey.navigation)) break;
      seen = mountingBy(navigation);
      timing.sigma = seen.time_offset_sigma;
      if (seen.misfit >= least) break;
      least = seen.misfit;
      best = Retimed{timing, std::move(navigation)};
    }
  }
  return best;
}

ImageScale imageScaleOf(const MissionInput& input, const TopsideConfig& config, const Navigation& navigation,
                        const Frames& frames, const std::vector<slam::NavigationLink>& of_pairs) {
  constexpr double kContradicts = 3;  // standard deviations, of what findRig() found
  ImageScale out;
  const slam::NavigationConfig graph = graphOf(input.mission, config.navigation);
  const slam::RigPrior& rig = graph.rig;
  const double open = hypotenuse(rig.principal_point, rig.turn);
  const std::vector<slam::KeyframeInput> inputs = inputsOf(frames, navigation);
  std::vector<slam::NavigationLink> links = of_pairs;
  for (slam::NavigationLink& link : links)
    for (std::uint32_t* end : {&link.a, &link.b})
      *end = static_cast<std::uint32_t>(std::lower_bound(frames.pair.begin(), frames.pair.end(), *end) -
                                        frames.pair.begin());
  const slam::PathScale path = slam::pathScaleOf(inputs, links, graph.dvl_in_camera, graph.noise);
  if (path.steps == 0) return out;
  const double range = median(frames.range);
  const double of_images = hypotenuse(rig.scale, open / rig.baseline * range),
               of_paths = hypotenuse(path.sigma, graph.noise.dvl_scale, inputs.front().sound_share),
               both = hypotenuse(of_images, of_paths);
  // What findRig() knows is not so where all steps contradict it.
  if (open == 0 && std::abs(path.longer) < kContradicts * both) return out;
  const double share = open == 0 ? 1 : of_images * of_images / (both * both);
  out.scale = std::exp(-share * path.longer);
  out.sigma = std::sqrt(share) * of_paths;
  out.range = range;
  out.steps = path.steps;
  return out;
}

}  // namespace fathom::topside
