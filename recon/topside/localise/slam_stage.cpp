#include "recon/topside/localise/slam_stage.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "recon/topside/localise/batch_closure_search.hpp"
#include "recon/topside/localise/feature_stage.hpp"
#include "recon/topside/localise/first_links.hpp"
#include "recon/topside/localise/navigation_inputs.hpp"
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
          slam.moved_rms, slam.unjoined, slam.timing, slam.scale, slam.parts, slam.refused_tilt, slam.bundled,
          slam.control);
}

namespace {

// Changes whenever the same inputs and settings give another result.
constexpr std::uint32_t kLocaliseVersion = 30;
constexpr std::size_t kClosureRounds = 3;     // of closures: each says where the next one looks
constexpr std::size_t kReportedPoses = 2000;  // whose uncertainty the report has, spread over the dive
constexpr double kAnywhere = 1000;            // standard deviation of nav's place where no fix tells it [m]

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

// One dive with navigation: its network of keyframes is solved again after every search for closures.
class Localisation {
 public:
  // All must outlive it; two frames at least.
  Localisation(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
               const Frames& frames, std::vector<slam::NavigationLink> odometry, SlamResult begun)
      : input_(input),
        config_(config),
        survey_(survey),
        frames_(frames),
        out_(std::move(begun)),
        graph_(graphOf(input.mission, config.navigation)),
        inputs_(inputsOf(frames, survey.navigation)),
        fixes_(fixesOf(frames, survey.navigation, graph_.noise)),
        search_(input.rig, frames, graph_.noise.visual_scale, graph_.rig),
        links_(std::move(odometry)) {
    bridge(inputs_, fixes_, links_, graph_.noise.unknown_velocity);
  }

  SlamResult run(const GreyImages& images) {
    const std::size_t odometry = links_.size();
    solveByOdometry();
    for (std::size_t round = 0; round < kClosureRounds; ++round)
      if (!findClosures()) break;
    recognise();
    adjust(images);
    if (input_.control) {
      ControlNetwork control(*input_.control, sightingsOf(*input_.control, survey_.list), input_.rig,
                             frames_);
      out_.control = held(control, graph_.rig.scale, solved_, links_);
      lap("control");
    }
    look();
    reportSearch();
    reportSensors();
    reportPoses();
    reportLinks(odometry);
    return std::move(out_);
  }

 private:
  void lap(const char* stage) { out_.seconds[stage] += watch_.lap(); }

  // Dead reckoning is given in nav already, as all fixes together place it; the graph weighs them again.
  void solve() {
    const Navigation& navigation = survey_.navigation;
    links_ = search_.straightened(std::move(links_), shared_ - straightened_by_);
    straightened_by_ = shared_;
    solved_ = slam::solveNavigation(graph_, inputs_, navigation.gps_shift.value_or(Eigen::Vector2d::Zero()),
                                    navigation.gps_shift ? navigation.gps_sigma : kAnywhere, links_, fixes_,
                                    std::move(solved_));
  }

  void solveByOdometry() {
    graph_.noise = slam::noiseBySteps(graph_.noise, inputs_, links_, graph_.dvl_in_camera);
    solve();
    graph_.noise = slam::adaptedNoise(graph_.noise, inputs_, fixes_, solved_);
    solved_ = {};
    solve();
    lap("network");
  }

  void look() {
    search_.look(solved_, links_, straightened_by_);
    shared_ = search_.known().shared();
  }

  // Adds links that were found, and solves with them.
  void take(std::vector<slam::NavigationLink> found) {
    found = search_.straightened(std::move(found), straightened_by_);
    links_.insert(links_.end(), found.begin(), found.end());
    solve();
    lap("network");
  }

  // One round; false when it found nothing.
  bool findClosures() {
    const auto a_frame = static_cast<std::size_t>(config_.slam_candidates);
    look();
    std::vector<Attempt> attempts =
        search_.candidates(a_frame * frames_.pair.size() / kClosureRounds, a_frame);
    lap("candidates");
    std::vector<slam::NavigationLink> found = search_.attempt(attempts);
    for (const Attempt& t : attempts)
      out_.tried.push_back({frames_.pair[t.a], frames_.pair[t.b], t.accepted()});
    lap("closures");
    if (found.empty()) return false;
    take(std::move(found));
    return true;
  }

  // Places that look alike wherever they are; one more round of closures if there are any.
  void recognise() {
    std::vector<slam::NavigationLink> found = recognisePlaces(input_.rig, frames_, solved_, links_);
    lap("places");
    if (found.empty()) return;
    for (const slam::NavigationLink& link : found)
      out_.tried.push_back({frames_.pair[link.a], frames_.pair[link.b], true});
    take(std::move(found));
    (void)findClosures();
  }

  // Bundle adjustment, and the errors that all features share.
  void adjust(const GreyImages& images) {
    const auto solve_again = [&] {
      solved_ = {};  // the sensors are judged by the steps as they are now
      solve();
    };
    const auto error = [&](const Eigen::Vector2d& tangent) {
      return search_.disparityError(straightened_by_, tangent);
    };
    out_.bundled =
        bundled(input_.rig, config_, survey_, frames_, images, links_, solved_.poses, solve_again, error);
    lap("bundle");
    shared_ = search_.estimate(solved_, links_, straightened_by_);
    solve();
  }

  void reportSearch() {
    const Crossings crossings = search_.crossings(links_);
    out_.crossings_expected = crossings.expected;
    out_.crossings_unverified = crossings.unverified;
    out_.unconfirmed = search_.unconfirmed();
    out_.converged = solved_.converged;
    lap("crossings");
    out_.refused = search_.refused();
  }

  void reportSensors() {
    out_.sensors = solved_.sensors;
    out_.mounting = slam::mountingOf(inputs_, links_, graph_.noise);
    const Eigen::Matrix3d R_body_cam = input_.mission.T_body_cam.matrix3();
    Eigen::Vector3d& sigma_turn = out_.mounting.camera_turn_sigma;
    sigma_turn = (R_body_cam.cwiseAbs2() * sigma_turn.cwiseAbs2()).cwiseSqrt();
    out_.mounting.camera_turn = R_body_cam * out_.mounting.camera_turn;
    for (const slam::NavigationFix& fix : fixes_) ++(fix.kept ? out_.fixes_kept : out_.fixes_removed);
    if (solved_.usbl_node >= 0) out_.usbl = usblOf(solved_, search_.known());
  }

  // With the uncertainty of some.
  void reportPoses() {
    double squares = 0;
    const std::size_t every = solved_.poses.size() / kReportedPoses + 1;
    for (std::size_t k = 0; k < solved_.poses.size(); ++k) {
      const SE3& pose = solved_.poses[k];
      squares += (pose.translation() - frames_.reckoned[k].translation()).head<2>().squaredNorm();
      out_.poses[frames_.pair[k]].T_nav_body = pose * input_.mission.T_body_cam.inverse();
      if (k % every == 0)
        out_.uncertain.push_back({frames_.pair[k], pose, Matrix6d::Zero(), Matrix6d::Zero()});
    }
    const slam::GraphCovariance& known = search_.known();
    const int first = solved_.nodes.front();
    const slam::GraphCovariance::TreePath from = known.pathOf(first);
    oneapi::tbb::parallel_for(std::size_t{0}, out_.uncertain.size(), [&](std::size_t i) {
      const int node = solved_.nodes[i * every];
      const slam::GraphCovariance::TreePath path = known.pathOf(node);
      out_.uncertain[i].covariance = known.of(node, path);
      out_.uncertain[i].since_first = known.between(first, from, node, path);
    });
    out_.moved_rms = std::sqrt(squares / static_cast<double>(solved_.poses.size()));
    for (const std::uint32_t frame : unjoined(inputs_, links_, graph_.noise.unknown_velocity)) {
      out_.poses[frames_.pair[frame]].T_nav_body.reset();
      ++out_.unjoined;
    }
    lap("covariance");
  }

  // The first `odometry` links are visual odometry.
  void reportLinks(std::size_t odometry) {
    for (std::size_t i = 0; i < links_.size(); ++i) {
      slam::NavigationLink link = links_[i];
      link.a = frames_.pair[link.a];
      link.b = frames_.pair[link.b];
      (i < odometry ? out_.odometry : out_.closures).push_back(link);
    }
    std::stable_sort(out_.closures.begin(), out_.closures.end(),
                     [](const slam::NavigationLink& x, const slam::NavigationLink& y) {
                       return x.a != y.a ? x.a < y.a : x.b < y.b;
                     });
  }

  const MissionInput& input_;
  const TopsideConfig& config_;
  const Survey& survey_;
  const Frames& frames_;
  SlamResult out_;
  slam::NavigationConfig graph_;
  std::vector<slam::KeyframeInput> inputs_;
  std::vector<slam::NavigationFix> fixes_;
  BatchClosureSearch search_;
  std::vector<slam::NavigationLink> links_;
  slam::NavigationSolution solved_;
  // Errors that all features share: as they are known now, and as they were taken out of the links.
  BatchClosureSearch::Shared shared_ = BatchClosureSearch::Shared::Zero(), straightened_by_ = shared_;
  Stopwatch watch_;
};

}  // namespace

Digest localiseKey(const MissionInput& input, const TopsideConfig& config, const Digest& survey,
                   const Digest& prepared) {
  Hasher hasher;
  hasher.add("localise", kLocaliseVersion, survey, prepared);
  addRig(hasher, input);
  addNavigationSettings(hasher, config);
  const slam::SensorNoise& n = config.navigation.noise;
  static_assert(sizeof n == 208);  // a new setting belongs here too
  hasher.add(config.slam, config.bundle, config.slam_features, config.slam_candidates,
             config.navigation.turned_sigmas, n.dvl_velocity, n.dvl_rate, n.dvl_scale, n.dvl_heading,
             n.dvl_place, n.unknown_velocity, n.heading, n.heading_lag, n.tilt, n.deviation,
             n.deviation_drift, n.deviation_turn, n.tilt_bias, n.tilt_turn, n.unknown_turn, n.gyro_walk,
             n.depth, n.depth_offset, n.depth_drift, n.tide_rate, n.usbl_shift, n.usbl_turn, n.visual_scale,
             n.dvl_wander, n.dvl_wander_s, n.usbl_wander_s);
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
  // NOLINTNEXTLINE(performance-unnecessary-copy-initialization): solve() moves the poses
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
  SlamResult out;
  out.poses = survey.navigation.poses;
  Frames frames = framesOf(input.mission, survey, features);
  for (std::size_t k = 0; k < frames.pair.size(); ++k) out.frames += frames.blank(k) ? 0U : 1U;
  if (frames.pair.size() < 2) return out;
  Stopwatch watch;
  std::vector<slam::NavigationLink> odometry = visualOdometry(input.rig, frames);
  std::optional<Retimed> better = retimed(input, config, survey, features, odometry);
  Survey put_right;
  if (better) {
    put_right = survey;
    put_right.navigation = std::move(better->navigation);
    out.poses = put_right.navigation.poses;
    out.timing = better->timing;
    frames = framesOf(input.mission, put_right, features);
    odometry = visualOdometry(input.rig, frames);
  }
  const Survey& seen = better ? put_right : survey;
  if (!input.features_only) odometry = withGroundSteps(input, seen, frames, std::move(odometry));
  out.seconds["odometry"] = watch.lap();
  const SlamResult begun = out;
  out = Localisation(input, config, seen, frames, std::move(odometry), begun).run(images);
  const ImageScale found = imageScaleOf(input, config, seen.navigation, frames, out.odometry);
  if (found.sigma == 0) return out;
  MissionInput turned = input;
  turned.rig = calibration::withoutRangeError(input.rig, found.error());
  const RetriangulatedFeatures turned_features(features, input.rig, turned.rig);
  frames = framesOf(input.mission, seen, turned_features);
  odometry = visualOdometry(turned.rig, frames);
  if (!input.features_only) odometry = withGroundSteps(turned, seen, frames, std::move(odometry));
  TopsideConfig known = config;
  known.navigation.rig.scale = found.sigma;
  const Costs before = out.seconds;
  out = Localisation(turned, known, seen, frames, std::move(odometry), begun).run(images);
  out.scale = found;
  for (const auto& [part, seconds] : before) out.seconds[part] += seconds;
  return out;
}

}  // namespace fathom::topside
