#include "recon/topside/localise/slam_stage.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "recon/geometry/sea_water.hpp"
#include "recon/navigation/graph/navigation_config.hpp"
#include "recon/topside/localise/batch_closure_search.hpp"
#include "recon/topside/localise/feature_stage.hpp"
#include "recon/topside/localise/recognised_places.hpp"
#include "recon/topside/localise/visual_odometry.hpp"
#include "recon/topside/work/run_stage_times.hpp"
#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::slam {

template <typename Archive>
void exchangeState(Archive& archive, topside::Is<NavigationLink> auto& link) {
  archive(link.a, link.b, link.T_a_b, link.covariance, link.inliers, link.chi2, link.kept);
}

template <typename Archive>
void exchangeState(Archive& archive, topside::Is<Mounting> auto& m) {
  archive(m.camera_turn, m.camera_turn_sigma, m.dvl_scale, m.dvl_scale_sigma, m.time_offset,
          m.time_offset_sigma, m.steps);
}

template <typename Archive>
void exchangeState(Archive& archive, topside::Is<NavigationGraph::Counters> auto& c) {
  archive(c.keyframes, c.keyframes_refused, c.references, c.odometry_links, c.closures, c.links_contradicting,
          c.links_off, c.links_refused, c.fixes, c.fixes_gated, c.fixes_off, c.fixes_refused,
          c.steps_contradicted, c.steps_left_out, c.compass_jumps, c.attitude_absent, c.depth_absent,
          c.dvl_absent, c.dvl_rejected);
}

}  // namespace fathom::slam

namespace fathom::topside {

template <typename Archive>
void exchangeState(Archive& archive, Is<SlamResult> auto& slam) {
  archive(slam.poses, slam.odometry, slam.closures, slam.frames, slam.tried, slam.refused,
          slam.crossings_expected, slam.crossings_unverified, slam.unconfirmed, slam.converged,
          slam.uncertain, slam.sensors, slam.mounting, slam.usbl, slam.fixes_kept, slam.fixes_removed,
          slam.moved_rms, slam.parts, slam.refused_tilt, slam.bundled, slam.control);
}

namespace {

// Changes whenever the same inputs and settings give another result.
constexpr std::uint32_t kLocaliseVersion = 13;
constexpr std::size_t kClosureRounds = 3;     // of closures: each says where the next one looks
constexpr std::size_t kReportedPoses = 2000;  // whose uncertainty the report has, spread over the dive
constexpr double kAnywhere = 1000;            // standard deviation of nav's place where no fix tells it [m]

std::vector<slam::KeyframeInput> inputsOf(const Frames& frames, const Navigation& navigation) {
  std::vector<slam::KeyframeInput> inputs;
  slam::LossOfTrack loss;
  for (std::size_t k = 0; k < frames.pair.size(); ++k) {
    const NavigatedPose& pose = navigation.poses[frames.pair[k]];
    const nav::DeadReckoning::Quality& before = navigation.poses[frames.pair[k == 0 ? 0 : k - 1]].quality;
    const nav::DeadReckoning::Quality& now = pose.quality;
    slam::KeyframeInput input;
    input.utc_ns = pose.utc_ns;
    input.T_odom_cam = frames.reckoned[k];
    input.unlocked_s = loss.add(now.unlocked_s - before.unlocked_s);
    input.sound_share = now.sound_share;
    input.untilted_s = now.untilted_s - before.untilted_s;
    input.attitude_held = now.attitude_held;
    input.depth_held = now.depth_held;
    input.pressure_off = now.pressure_off;
    input.pressure_sigma = now.pressure_sigma;
    input.compass_jumped = now.heading_leaps > before.heading_leaps;
    input.gyro_turn = now.gyro_turn - before.gyro_turn;
    input.ungyro_s = now.has_gyro ? now.ungyro_s - before.ungyro_s : -1;
    inputs.push_back(input);
  }
  return inputs;
}

// USBL fixes, and GPS of a vehicle that came up during the dive, each at the frame nearest to it in time.
// What GPS said before, the anchor has.
std::vector<slam::NavigationFix> fixesOf(const Frames& frames, const Navigation& navigation) {
  std::vector<slam::NavigationFix> fixes;
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
    fix.sigma = seen.sigma;
    fix.by_usbl = seen.kind == nav::FixKind::kUsbl;
    fixes.push_back(fix);
  }
  return fixes;
}

// A solution held by control points; links are scaled with it.
ControlResult held(ControlNetwork& control, double scale_sigma, slam::NavigationSolution& solved,
                   std::vector<slam::NavigationLink>& links) {
  ControlNetwork::Solved network{&solved.graph, solved.nodes, 0, {}, scale_sigma};
  for (const slam::NavigationLink& link : links)
    if (link.edge >= 0) network.visual.push_back(static_cast<std::size_t>(link.edge));
  ControlResult out = control.adjust(network);
  for (slam::NavigationLink& link : links) link.T_a_b = grown(link.T_a_b, out.scale);
  for (std::size_t k = 0; k < solved.poses.size(); ++k)
    solved.poses[k] = solved.graph.poses[static_cast<std::size_t>(solved.nodes[k])];
  solved.converged = out.converged;
  return out;
}

SlamResult::Usbl usblOf(const slam::NavigationSolution& solved, const slam::GraphCovariance& known) {
  const SE3 now = solved.graph.poses[static_cast<std::size_t>(solved.usbl_node)];
  const Vector6d variance = known.of(solved.usbl_node).diagonal();  // level but for the turn, which is small
  return {true, (now.translation() - solved.T_nav_usbl.translation()).head<2>(),
          variance.head<2>().cwiseSqrt(), now.euler().z(), std::sqrt(variance(5))};
}

}  // namespace

Digest localiseKey(const MissionInput& input, const TopsideConfig& config, const Digest& survey,
                   const Digest& prepared) {
  Hasher hasher;
  hasher.add("localise", kLocaliseVersion, survey, prepared);
  addRig(hasher, input);
  addNavigationSettings(hasher, config);
  const slam::SensorNoise& n = config.navigation.noise;
  static_assert(sizeof n == 200);  // a new setting belongs here too
  hasher.add(config.slam, config.bundle, config.slam_features, config.slam_candidates,
             config.navigation.turned_sigmas, n.dvl_velocity, n.dvl_rate, n.dvl_scale, n.dvl_heading,
             n.dvl_place, n.unknown_velocity, n.heading, n.heading_lag, n.tilt, n.deviation,
             n.deviation_drift, n.deviation_turn, n.tilt_bias, n.tilt_turn, n.unknown_turn, n.gyro_walk,
             n.depth, n.depth_offset, n.depth_drift, n.tide_rate, n.usbl_shift, n.usbl_turn, n.visual_scale,
             n.dvl_wander, n.dvl_wander_s);
  if (input.control) hasher.add("control", input.control_identity);
  const slam::RigPrior& open = config.navigation.rig;
  hasher.add(open.scale, open.principal_point, open.turn, open.curl, open.spin, open.ground_tilt,
             open.uneven);
  return hasher.finish();
}

void saveSlam(WorkFileWriter& file, const SlamResult& slam) {
  saveBlock(file, "slam", slam);
}

SlamResult loadSlam(const WorkFile& file) {
  return loadBlock<SlamResult>(file, "slam");
}

SlamResult::Bundled bundled(const StereoRig& rig, const TopsideConfig& config, const Survey& survey,
                            const Frames& frames, const GreyImages& images,
                            std::vector<slam::NavigationLink>& links, const std::vector<SE3>& poses,
                            const std::function<void()>& solve, const DisparityError& error) {
  SlamResult::Bundled out;
  if (!config.bundle) return out;
  const std::vector<SE3> before = poses;
  const BundledLinks found = bundle(rig, frames, poses, survey.planes, images, links, error);
  out.points = found.result.points;
  out.sightings = found.result.sightings;
  out.pixel_before = found.result.place_before;
  out.pixel_after = found.result.place_after;
  out.links = found.links;
  out.done = found.links > 0;
  if (!out.done) return out;
  solve();
  double squares = 0;
  for (std::size_t k = 0; k < before.size(); ++k)
    squares += (poses[k].translation() - before[k].translation()).squaredNorm();
  out.moved_rms = std::sqrt(squares / static_cast<double>(before.size()));
  return out;
}

SlamResult localise(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                    const FeatureStore& features, const GreyImages& images) {
  const io::MissionConfig& mission = input.mission;
  const StereoRig& rig = input.rig;
  const Navigation& navigation = survey.navigation;
  SlamResult out;
  out.poses = navigation.poses;
  Stopwatch watch;
  const auto lap = [&](const char* stage) { out.seconds[stage] += watch.lap(); };
  const Frames frames = framesOf(mission, survey, features);
  for (std::size_t k = 0; k < frames.pair.size(); ++k) out.frames += frames.blank(k) ? 0U : 1U;
  if (frames.pair.size() < 2) return out;

  std::vector<slam::NavigationLink> links = visualOdometry(rig, frames);
  const std::size_t odometry = links.size();
  lap("odometry");

  // Dead reckoning is given in nav already, as all fixes together place it; the graph weighs them again.
  const std::vector<slam::KeyframeInput> inputs = inputsOf(frames, navigation);
  std::vector<slam::NavigationFix> fixes = fixesOf(frames, navigation);
  const Eigen::Vector2d shift = navigation.gps_shift.value_or(Eigen::Vector2d::Zero());
  const double sigma = navigation.gps_shift ? navigation.gps_sigma : kAnywhere;
  slam::NavigationConfig graph = config.navigation;
  const bool predicted = readTide(mission.tide_model, mission.start_utc_ns).has_value();
  graph.noise = predicted ? slam::withTideModel(graph.noise) : slam::withoutTideModel(graph.noise);
  graph.dvl_in_camera = mission.T_body_cam.inverse() * mission.T_body_dvl.translation();
  graph.forward_in_camera = mission.T_body_cam.rotation().conjugate() * Eigen::Vector3d::UnitX();
  slam::NavigationSolution solved;
  BatchClosureSearch search(rig, frames, graph.noise.visual_scale, graph.rig);
  BatchClosureSearch::Shared shared = BatchClosureSearch::Shared::Zero(), straightened_by = shared;
  const auto solve = [&] {
    links = search.straightened(std::move(links), shared - straightened_by);
    straightened_by = shared;
    solved = slam::solveNavigation(graph, inputs, shift, sigma, links, fixes, std::move(solved));
  };
  const auto take = [&](std::vector<slam::NavigationLink> found) {
    found = search.straightened(std::move(found), straightened_by);
    links.insert(links.end(), found.begin(), found.end());
  };
  const auto look = [&] {
    search.look(solved, links, straightened_by);
    shared = search.known().shared();
  };
  solve();
  graph.noise = slam::adaptedNoise(graph.noise, inputs, fixes, solved);
  solved = {};
  solve();
  lap("network");
  const auto a_frame = static_cast<std::size_t>(config.slam_candidates);
  const std::size_t most = a_frame * frames.pair.size() / kClosureRounds;
  // False when nothing was found.
  const auto seek = [&] {
    look();
    std::vector<Attempt> attempts = search.candidates(most, a_frame);
    lap("candidates");
    std::vector<slam::NavigationLink> found = search.attempt(attempts);
    for (const Attempt& t : attempts) out.tried.push_back({frames.pair[t.a], frames.pair[t.b], t.accepted()});
    lap("closures");
    if (found.empty()) return false;
    take(std::move(found));
    solve();
    lap("network");
    return true;
  };
  for (std::size_t round = 0; round < kClosureRounds && seek(); ++round) continue;
  const std::vector<slam::NavigationLink> recognised = recognisePlaces(rig, frames, solved, links);
  lap("places");
  for (const slam::NavigationLink& link : recognised)
    out.tried.push_back({frames.pair[link.a], frames.pair[link.b], true});
  if (!recognised.empty()) {
    take(recognised);
    solve();
    lap("network");
    (void)seek();
  }
  const auto solve_again = [&] {
    solved = {};  // the sensors are judged by the steps as they are now
    solve();
  };
  out.bundled = bundled(rig, config, survey, frames, images, links, solved.poses, solve_again,
                        [&](const auto& tangent) { return search.disparityError(straightened_by, tangent); });
  lap("bundle");
  shared = search.estimate(solved, links, straightened_by);
  solve();
  if (input.control) {
    ControlNetwork control(*input.control, sightingsOf(*input.control, survey.list), rig, frames);
    out.control = held(control, graph.rig.scale, solved, links);
    lap("control");
  }
  look();
  const Crossings crossings = search.crossings(links);
  out.crossings_expected = crossings.expected;
  out.crossings_unverified = crossings.unverified;
  out.unconfirmed = search.unconfirmed();
  out.converged = solved.converged;
  lap("crossings");
  out.refused = search.refused();
  out.sensors = solved.sensors;
  out.mounting = slam::mountingOf(inputs, links, graph.noise);
  const Eigen::Matrix3d R_body_cam = mission.T_body_cam.matrix3();
  Eigen::Vector3d& sigma_turn = out.mounting.camera_turn_sigma;
  sigma_turn = (R_body_cam.cwiseAbs2() * sigma_turn.cwiseAbs2()).cwiseSqrt();
  out.mounting.camera_turn = R_body_cam * out.mounting.camera_turn;
  for (const slam::NavigationFix& fix : fixes) ++(fix.kept ? out.fixes_kept : out.fixes_removed);

  const slam::GraphCovariance& known = search.known();
  if (solved.usbl_node >= 0) out.usbl = usblOf(solved, known);
  double squares = 0;
  const std::size_t every = solved.poses.size() / kReportedPoses + 1;
  for (std::size_t k = 0; k < solved.poses.size(); ++k) {
    const SE3& pose = solved.poses[k];
    squares += (pose.translation() - frames.reckoned[k].translation()).head<2>().squaredNorm();
    out.poses[frames.pair[k]].T_nav_body = pose * mission.T_body_cam.inverse();
    if (k % every == 0) out.uncertain.push_back({frames.pair[k], pose, Matrix6d::Zero(), Matrix6d::Zero()});
  }
  const int first = solved.nodes.front();
  const slam::GraphCovariance::TreePath from = known.pathOf(first);
  oneapi::tbb::parallel_for(std::size_t{0}, out.uncertain.size(), [&](std::size_t i) {
    const int node = solved.nodes[i * every];
    const slam::GraphCovariance::TreePath path = known.pathOf(node);
    out.uncertain[i].covariance = known.of(node, path);
    out.uncertain[i].since_first = known.between(first, from, node, path);
  });
  out.moved_rms = std::sqrt(squares / static_cast<double>(solved.poses.size()));
  lap("covariance");
  for (std::size_t i = 0; i < links.size(); ++i) {
    slam::NavigationLink link = links[i];
    link.a = frames.pair[link.a];
    link.b = frames.pair[link.b];
    (i < odometry ? out.odometry : out.closures).push_back(link);
  }
  std::stable_sort(out.closures.begin(), out.closures.end(),
                   [](const slam::NavigationLink& x, const slam::NavigationLink& y) {
                     return x.a != y.a ? x.a < y.a : x.b < y.b;
                   });
  return out;
}

}  // namespace fathom::topside
