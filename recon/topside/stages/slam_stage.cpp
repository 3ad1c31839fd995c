#include "recon/topside/stages/slam_stage.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include "recon/closure/candidates.hpp"
#include "recon/nav/position_anchor.hpp"
#include "recon/topside/stage_times.hpp"
#include "recon/topside/stages/feature_stage.hpp"

namespace fathom::topside {
namespace {

namespace tbb = oneapi::tbb;

// Of dead reckoning between consecutive pairs, as a prior that visual odometry must agree with.
constexpr double kStepSigma = 0.05, kStepAngle = 0.03;  // [m], [rad]
// Growth of the horizontal uncertainty between two pairs with the way between them, before any closure
// (compass deviation) and after a round of closures; never less than the least.
constexpr std::array<double, 3> kDrift = {0.04, 0.01, 0.005};
constexpr double kLeastSigma = 0.05;  // [m]
constexpr double kPriorAngle = 0.1;   // of two poses' difference, compass deviation both ways [rad]
// Between consecutive pairs dead reckoning vouches for the pose, and a ledge may fill most of the shared
// view.
constexpr double kStepCoverage = 0.2, kStepShare = 0.05;
constexpr std::uint32_t kSkip = 4;         // latest frames that odometry links well enough
constexpr std::size_t kCapacity = 200000;  // candidates that wait

Matrix6d covarianceOf(double position, double angle) {
  Vector6d variance;
  variance << Eigen::Vector3d::Constant(position * position), Eigen::Vector3d::Constant(angle * angle);
  return variance.asDiagonal();
}

struct Attempt {
  std::uint32_t a = 0, b = 0;
  closure::RelativePrior prior;
  closure::Registration result;
};

void registerAll(const StereoRig& rig, const Frames& frames, const closure::RegistrationConfig& config,
                 std::vector<Attempt>& attempts, const char* stage) {
  tbb::enumerable_thread_specific<std::unique_ptr<closure::Registrar>> registrars;
  SharedProgress progress(stage, attempts.size());
  tbb::parallel_for(std::size_t{0}, attempts.size(), [&](std::size_t k) {
    auto& registrar = registrars.local();
    if (!registrar) registrar = std::make_unique<closure::Registrar>(rig, config);
    Attempt& t = attempts[k];
    t.result = registrar->process(frames.features[t.a], frames.features[t.b], t.prior);
    progress.step();
  });
}

void keep(const std::vector<Attempt>& attempts, std::vector<CameraLink>& links) {
  for (const Attempt& t : attempts)
    if (t.result.accepted())
      links.push_back({t.a, t.b, t.result.T_a_b, t.result.covariance,
                       static_cast<int>(t.result.inliers.size()), 0, true});
}

// The most valuable candidates of one round that were not tried before, in the order of their worth.
std::vector<Attempt> candidatesOf(const StereoRig& rig, const Frames& frames, const std::vector<SE3>& poses,
                                  double drift, std::size_t most,
                                  std::set<std::pair<std::uint32_t, std::uint32_t>>& tried) {
  const auto sigma = [&](std::uint32_t a, std::uint32_t b) {
    return std::max(kLeastSigma, drift * std::abs(frames.way[b] - frames.way[a]));
  };
  closure::CandidateConfig config;
  config.capacity = kCapacity;
  closure::CandidateQueue queue(config);
  std::vector<closure::Footprint> footprints;
  for (std::uint32_t k = 0; k < poses.size(); ++k) {
    footprints.push_back(closure::footprintOf(poses[k], frames.altitude[k], rig.left));
    queue.propose(footprints, k, kSkip, std::max(kLeastSigma, drift * frames.way[k]),
                  [&](std::uint32_t a, std::uint32_t b) -> Eigen::Matrix2d {
                    return Eigen::Matrix2d::Identity() * sigma(a, b) * sigma(a, b);
                  });
  }
  std::vector<Attempt> attempts;
  closure::Candidate candidate;
  while (attempts.size() < most && queue.pop(candidate)) {
    if (!tried.emplace(candidate.older, candidate.newer).second) continue;
    Attempt t;
    t.a = candidate.older;
    t.b = candidate.newer;
    t.prior = {poses[t.a].inverse() * poses[t.b], covarianceOf(sigma(t.a, t.b), kPriorAngle)};
    attempts.push_back(t);
  }
  return attempts;
}

// The shift from the solved shape to the fixes; each fix sees the pose nearest to it in time.
Eigen::Vector2d shiftToFixes(const Navigation& navigation, const Frames& frames,
                             const std::vector<SE3>& solved) {
  nav::PositionAnchor anchor;
  for (const FixSeen& fix : navigation.fixes) {
    const auto later = std::lower_bound(
        frames.pair.begin(), frames.pair.end(), fix.utc_ns,
        [&](std::uint32_t pair, std::int64_t t) { return navigation.poses[pair].utc_ns < t; });
    std::size_t k = static_cast<std::size_t>(later - frames.pair.begin());
    if (k == frames.pair.size() || (k > 0 && fix.utc_ns - navigation.poses[frames.pair[k - 1]].utc_ns <
                                                 navigation.poses[frames.pair[k]].utc_ns - fix.utc_ns))
      --k;
    const Eigen::Vector3d receiver = solved[k] * (frames.reckoned[k].inverse() * fix.receiver);
    anchor.add(fix.kind, fix.north_east - receiver.head<2>(), fix.sigma);
  }
  const auto estimate = anchor.estimate();
  return estimate ? estimate->shift : Eigen::Vector2d::Zero();
}

}  // namespace

SlamResult localise(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
                    const TopsideConfig& config, const LightingModels& lighting, const PairList& list,
                    const Navigation& navigation) {
  SlamResult out;
  out.poses = navigation.poses;
  Stopwatch watch;
  const auto lap = [&](const char* stage) { out.stage_seconds.emplace_back(stage, watch.lap()); };
  const Frames frames = extractFeatures(paths, mission, rig, config, lighting, list, navigation);
  out.frames = frames.pair.size();
  lap("features");
  if (frames.pair.size() < 2) return out;

  std::vector<Attempt> steps;
  for (std::uint32_t k = 0; k + 1 < frames.pair.size(); ++k) {
    Attempt t;
    t.a = k;
    t.b = k + 1;
    t.prior = {frames.reckoned[k].inverse() * frames.reckoned[k + 1], covarianceOf(kStepSigma, kStepAngle)};
    steps.push_back(t);
  }
  closure::RegistrationConfig close_by;
  close_by.min_coverage = kStepCoverage;
  close_by.min_inlier_share = kStepShare;
  registerAll(rig, frames, close_by, steps, "odometry");
  std::vector<CameraLink> links;
  keep(steps, links);
  const std::size_t odometry = links.size();
  lap("odometry");

  std::vector<SE3> solved = solveNetwork(frames.reckoned, links, {});
  lap("network");
  std::set<std::pair<std::uint32_t, std::uint32_t>> tried;
  const std::size_t most =
      static_cast<std::size_t>(config.slam_candidates) * frames.pair.size() / kDrift.size();
  for (const double drift : kDrift) {
    std::vector<Attempt> attempts = candidatesOf(rig, frames, solved, drift, most, tried);
    lap("candidates");
    registerAll(rig, frames, {}, attempts, "closures");
    out.tried += attempts.size();
    for (const Attempt& t : attempts) ++out.refused[static_cast<std::size_t>(t.result.refusal)];
    keep(attempts, links);
    lap("closures");
    for (CameraLink& link : links) link.kept = true;
    solved = solveNetwork(frames.reckoned, links, {});
    lap("network");
  }

  const Eigen::Vector2d shift = shiftToFixes(navigation, frames, solved);
  double squares = 0;
  for (std::size_t k = 0; k < solved.size(); ++k) {
    const SE3 placed(solved[k].rotation(),
                     solved[k].translation() + Eigen::Vector3d(shift.x(), shift.y(), 0));
    squares += (placed.translation() - frames.reckoned[k].translation()).head<2>().squaredNorm();
    out.poses[frames.pair[k]].T_nav_body = placed * mission.T_body_cam.inverse();
  }
  out.moved_rms = std::sqrt(squares / static_cast<double>(solved.size()));
  for (std::size_t i = 0; i < links.size(); ++i) {
    CameraLink link = links[i];
    link.a = frames.pair[link.a];
    link.b = frames.pair[link.b];
    (i < odometry ? out.odometry : out.closures).push_back(link);
  }
  std::stable_sort(out.closures.begin(), out.closures.end(), [](const CameraLink& x, const CameraLink& y) {
    return x.a != y.a ? x.a < y.a : x.b < y.b;
  });
  return out;
}

}  // namespace fathom::topside
