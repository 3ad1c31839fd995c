#include "recon/topside/stages/closure_search.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "recon/closure/candidates.hpp"
#include "recon/slam/graph_covariance.hpp"
#include "recon/topside/progress.hpp"

namespace fathom::topside {
namespace {

namespace tbb = oneapi::tbb;

// Of dead reckoning between consecutive pairs, as a prior that visual odometry must agree with; and where it
// did not, what the vehicle can have done between them at all.
constexpr double kStepSigma = 0.05, kStepAngle = 0.03;  // [m], [rad]
constexpr double kWideSigma = 0.5, kWideAngle = 0.6;    // [m], [rad]
// Between consecutive pairs dead reckoning vouches for the pose, and a ledge may fill most of the shared
// view.
constexpr double kStepCoverage = 0.2, kStepShare = 0.05;
constexpr double kLeastSigma = 0.05, kLeastAngle = 0.02;  // of a prior for a closure [m], [rad]
constexpr double kPriorScale = 4;   // of a prior's covariance: the solution may rest on a wrong closure
constexpr std::uint32_t kSkip = 4;  // latest frames that odometry links well enough
constexpr std::size_t kCapacity = 200000;   // candidates that wait
constexpr std::size_t kAskedPlaces = 2000;  // whose uncertainty is computed in a round

Matrix6d covarianceOf(double position, double angle) {
  Vector6d variance;
  variance << Eigen::Vector3d::Constant(position * position), Eigen::Vector3d::Constant(angle * angle);
  return variance.asDiagonal();
}

void registerAll(const StereoRig& rig, const Frames& frames, const closure::RegistrationConfig& config,
                 std::vector<Attempt>& attempts, const char* stage) {
  struct Worker {
    std::unique_ptr<closure::Registrar> registrar;
    closure::FrameFeatures a, b;
  };
  tbb::enumerable_thread_specific<Worker> workers;
  SharedProgress progress(stage, attempts.size());
  tbb::parallel_for(std::size_t{0}, attempts.size(), [&](std::size_t k) {
    Worker& worker = workers.local();
    if (!worker.registrar) worker.registrar = std::make_unique<closure::Registrar>(rig, config);
    Attempt& t = attempts[k];
    frames.load(t.a, worker.a);
    frames.load(t.b, worker.b);
    t.result = worker.registrar->process(worker.a, worker.b, t.prior);
    progress.step();
  });
}

slam::NavigationLink linkOf(const Attempt& t) {
  slam::NavigationLink link;
  link.a = t.a;
  link.b = t.b;
  link.T_a_b = t.result.T_a_b;
  link.covariance = t.result.covariance;
  link.inliers = static_cast<int>(t.result.inliers.size());
  return link;
}

}  // namespace

std::vector<slam::NavigationLink> visualOdometry(const StereoRig& rig, const Frames& frames) {
  std::vector<Attempt> steps, again;
  for (std::uint32_t k = 0; k + 1 < frames.pair.size(); ++k) {
    if (frames.blank(k) || frames.blank(k + 1)) continue;
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
  for (const Attempt& t : steps)
    if (!t.result.accepted()) {
      again.push_back(t);
      again.back().prior.covariance = covarianceOf(kWideSigma, kWideAngle);
    }
  registerAll(rig, frames, {}, again, "odometry, widely");
  std::vector<slam::NavigationLink> links;
  for (const auto* list : {&steps, &again})
    for (const Attempt& t : *list)
      if (t.result.accepted()) links.push_back(linkOf(t));
  std::sort(links.begin(), links.end(), [](const auto& x, const auto& y) { return x.a < y.a; });
  return links;
}

std::vector<Attempt> ClosureSearch::candidates(const slam::NavigationSolution& solution, double drift,
                                               std::size_t most) {
  slam::GraphCovariance known(solution.graph);
  // Of a frame's place against the first frame's: two of them bound what is between two frames.
  // Each costs a way through the factor, which grows with the dive: of a long one the widest of two that were
  // asked for bounds those between.
  const std::size_t count = solution.nodes.size(), step = count / kAskedPlaces + 1;
  const auto asked = [&](std::size_t k) {
    const Matrix6d covariance = known.between(solution.nodes.front(), solution.nodes[k]);
    return std::sqrt(covariance.topLeftCorner<3, 3>().trace());
  };
  std::vector<double> spread(count);
  double before = 0;
  for (std::size_t first = 0; first < count; first += step) {
    const std::size_t last = std::min(first + step, count) - 1;
    const double here = asked(last);
    for (std::size_t k = first; k <= last; ++k) spread[k] = k == last ? here : std::max(before, here);
    before = here;
  }
  const auto sigma = [&](std::uint32_t a, std::uint32_t b) {
    const double by_way = drift * std::abs(frames_.way[b] - frames_.way[a]);
    return std::max(kLeastSigma, std::min(std::hypot(spread[a], spread[b]), by_way));
  };
  closure::CandidateConfig config;
  config.capacity = kCapacity;
  closure::CandidateQueue queue(config);
  std::vector<closure::Footprint> footprints;
  double widest = 0;
  for (std::uint32_t k = 0; k < solution.poses.size(); ++k) {
    footprints.push_back(closure::footprintOf(solution.poses[k], frames_.altitude[k], rig_.left));
    widest = std::max(widest, spread[k]);
    if (frames_.blank(k)) continue;
    const double reach = std::min(std::hypot(widest, spread[k]), drift * frames_.way[k]);
    queue.propose(footprints, k, kSkip, std::max(kLeastSigma, reach),
                  [&](std::uint32_t a, std::uint32_t b) -> Eigen::Matrix2d {
                    return Eigen::Matrix2d::Identity() * sigma(a, b) * sigma(a, b);
                  });
  }
  std::vector<Attempt> attempts;
  closure::Candidate candidate;
  while (attempts.size() < most && queue.pop(candidate)) {
    if (frames_.blank(candidate.older)) continue;
    if (!tried_.emplace(candidate.older, candidate.newer).second) continue;
    Attempt t;
    t.a = candidate.older;
    t.b = candidate.newer;
    t.prior = {solution.poses[t.a].inverse() * solution.poses[t.b],
               kPriorScale * known.between(solution.nodes[t.a], solution.nodes[t.b]) +
                   covarianceOf(kLeastSigma, kLeastAngle)};
    attempts.push_back(t);
  }
  return attempts;
}

std::vector<slam::NavigationLink> ClosureSearch::attempt(std::vector<Attempt>& attempts) {
  registerAll(rig_, frames_, {}, attempts, "closures");
  std::vector<slam::NavigationLink> links;
  for (const Attempt& t : attempts) {
    ++refused_[static_cast<std::size_t>(t.result.refusal)];
    if (t.result.accepted()) links.push_back(linkOf(t));
  }
  return links;
}

}  // namespace fathom::topside
