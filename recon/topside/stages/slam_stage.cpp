#include "recon/topside/stages/slam_stage.hpp"

#include <algorithm>
#include <cmath>

#include "recon/topside/stage_times.hpp"
#include "recon/topside/stages/closure_search.hpp"
#include "recon/topside/stages/feature_stage.hpp"
#include "recon/topside/stages/recognised_places.hpp"

namespace fathom::topside {
namespace {

// Bounds of the growth of the horizontal uncertainty between two pairs with the way between them, before any
// closure (compass deviation) and after a round of closures.
constexpr std::array<double, 3> kDrift = {0.04, 0.01, 0.005};
constexpr std::size_t kToldPlaces = 2000;  // whose uncertainty the report has, spread over the dive
constexpr double kAnywhere = 1000;         // standard deviation of nav's place where no fix tells it [m]

std::vector<slam::KeyframeInput> inputsOf(const Frames& frames, const Navigation& navigation) {
  std::vector<slam::KeyframeInput> inputs;
  for (std::size_t k = 0; k < frames.pair.size(); ++k) {
    slam::KeyframeInput input;
    // Pairs without a pose lie between: what happened there belongs to the next one.
    for (std::size_t i = k == 0 ? frames.pair[0] : frames.pair[k - 1] + 1; i <= frames.pair[k]; ++i) {
      input.unlocked_s += navigation.poses[i].unlocked_s;
      input.untilted_s += navigation.poses[i].untilted_s;
      input.compass_jumped = input.compass_jumped || navigation.poses[i].compass_leapt;
    }
    const NavigatedPose& pose = navigation.poses[frames.pair[k]];
    input.utc_ns = pose.utc_ns;
    input.T_odom_cam = frames.reckoned[k];
    input.attitude_held = pose.attitude_held;
    input.depth_held = pose.depth_held;
    inputs.push_back(input);
  }
  return inputs;
}

// USBL fixes, each at the frame nearest to it in time.
std::vector<slam::NavigationFix> fixesOf(const Frames& frames, const Navigation& navigation) {
  std::vector<slam::NavigationFix> fixes;
  for (const FixSeen& seen : navigation.fixes) {
    if (seen.kind != nav::FixKind::kUsbl) continue;
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
    fixes.push_back(fix);
  }
  return fixes;
}

}  // namespace

SlamResult localise(const io::MissionConfig& mission, const StereoRig& rig, const TopsideConfig& config,
                    const Navigation& navigation, const FeatureStore& features) {
  SlamResult out;
  out.poses = navigation.poses;
  Stopwatch watch;
  const auto lap = [&](const char* stage) { out.stage_seconds.emplace_back(stage, watch.lap()); };
  const Frames frames = framesOf(mission, config, navigation, features);
  for (std::size_t k = 0; k < frames.pair.size(); ++k) out.frames += frames.blank(k) ? 0U : 1U;
  if (frames.pair.size() < 2) return out;

  std::vector<slam::NavigationLink> links = visualOdometry(rig, frames);
  const std::size_t odometry = links.size();
  lap("odometry");

  // Dead reckoning is given in nav already, as all fixes together place it; the graph weighs them anew.
  const std::vector<slam::KeyframeInput> inputs = inputsOf(frames, navigation);
  std::vector<slam::NavigationFix> fixes = fixesOf(frames, navigation);
  const Eigen::Vector2d shift = navigation.gps_shift.value_or(Eigen::Vector2d::Zero());
  const double sigma = navigation.gps_shift ? navigation.gps_sigma : kAnywhere;
  slam::NavigationConfig graph = config.navigation;
  graph.lever = (mission.T_body_cam.translation() - mission.T_body_dvl.translation()).norm();
  const auto solve = [&] {
    for (slam::NavigationLink& link : links) link.kept = true;
    for (slam::NavigationFix& fix : fixes) fix.kept = true;
    return slam::solveNavigation(graph, inputs, shift, sigma, links, fixes);
  };
  slam::NavigationSolution solved = solve();
  lap("network");
  ClosureSearch search(rig, frames);
  const std::size_t most =
      static_cast<std::size_t>(config.slam_candidates) * frames.pair.size() / kDrift.size();
  for (const double drift : kDrift) {
    if (drift == kDrift.back()) {
      const std::vector<slam::NavigationLink> recognised = recognisePlaces(rig, frames, solved, links);
      links.insert(links.end(), recognised.begin(), recognised.end());
      if (!recognised.empty()) solved = solve();
      lap("places");
    }
    std::vector<Attempt> attempts = search.candidates(solved, drift, most);
    lap("candidates");
    const std::vector<slam::NavigationLink> found = search.attempt(attempts);
    for (const Attempt& t : attempts)
      out.tried.push_back({frames.pair[t.a], frames.pair[t.b], t.result.accepted()});
    links.insert(links.end(), found.begin(), found.end());
    lap("closures");
    solved = solve();
    lap("network");
  }
  out.refused = search.refused();
  out.sensors = solved.sensors;
  out.dvl_scale = solved.dvl_scale;
  out.dvl_heading = solved.dvl_heading;
  for (const slam::NavigationFix& fix : fixes) ++(fix.kept ? out.fixes_kept : out.fixes_removed);

  slam::GraphCovariance known(solved.graph, graph.noise.visual_scale, solved.nodes);
  double squares = 0;
  const std::size_t told = solved.poses.size() / kToldPlaces + 1;
  for (std::size_t k = 0; k < solved.poses.size(); ++k) {
    const SE3& pose = solved.poses[k];
    squares += (pose.translation() - frames.reckoned[k].translation()).head<2>().squaredNorm();
    out.poses[frames.pair[k]].T_nav_body = pose * mission.T_body_cam.inverse();
    if (k % told != 0) continue;
    out.uncertain.push_back({frames.pair[k], pose, known.of(solved.nodes[k]),
                             known.between(solved.nodes.front(), solved.nodes[k])});
  }
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
