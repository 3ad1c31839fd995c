#include "recon/topside/localise/first_links.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <algorithm>
#include <limits>
#include <set>

#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "recon/closure/candidates.hpp"
#include "recon/closure/place_index.hpp"
#include "recon/geometry/uncertain_pose.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "recon/topside/localise/batch_closure_search.hpp"
#include "recon/topside/localise/ground_alignment.hpp"

namespace fathom::topside {
namespace {

// Of dead reckoning between consecutive pairs, as a prior that visual odometry must agree with; and where it
// did not, what the vehicle can have done between them at all.
constexpr double kStepSigma = 0.05, kStepAngle = 0.03;  // [m], [rad]
constexpr double kWideSigma = 0.5, kWideAngle = 0.6;    // [m], [rad]
// Between consecutive pairs dead reckoning confirms the pose, and a ledge may fill most of the shared
// view.
constexpr double kStepCoverage = 0.2, kStepShare = 0.05;

// Links whose turn contradicts dead reckoning, against one from the frame before over both steps.
void confirm(const StereoRig& rig, const Frames& frames, std::vector<slam::NavigationLink>& links) {
  std::vector<Attempt> across;
  std::vector<std::size_t> of_link;
  for (std::size_t i = 1; i < links.size(); ++i) {
    const slam::NavigationLink &before = links[i - 1], &link = links[i];
    const SE3 T_a_b = frames.reckoned[link.a].inverse() * frames.reckoned[link.b];
    if (before.b != link.a || !slam::worthConfirming(T_a_b, link.T_a_b)) continue;
    Attempt t;
    t.a = before.a;
    t.b = link.b;
    t.prior = {frames.reckoned[t.a].inverse() * frames.reckoned[t.b], covarianceOf(kWideSigma, kWideAngle)};
    across.push_back(t);
    of_link.push_back(i);
  }
  registerAll(rig, frames, {}, across, "odometry, confirmed");
  for (std::size_t k = 0; k < across.size(); ++k) {
    const slam::NavigationLink &before = links[of_link[k] - 1], &both = across[k].link;
    slam::NavigationLink& link = links[of_link[k]];
    link.confirmed = across[k].accepted() &&
                     closesTriangle({both.T_a_b, both.covariance}, {before.T_a_b, before.covariance},
                                    {link.T_a_b, link.covariance});
  }
}

}  // namespace

closure::RegistrationConfig stepRules() {
  closure::RegistrationConfig rules;
  rules.min_coverage = kStepCoverage;
  rules.min_inlier_share = kStepShare;
  return rules;
}

closure::RelativePrior stepPrior(const SE3& T_a_b) {
  return {T_a_b, covarianceOf(kStepSigma, kStepAngle)};
}

std::vector<slam::NavigationLink> visualOdometry(const StereoRig& rig, const Frames& frames) {
  std::vector<Attempt> steps, again;
  for (std::uint32_t k = 0; k + 1 < frames.pair.size(); ++k) {
    if (frames.blank(k) || frames.blank(k + 1)) continue;
    Attempt t;
    t.a = k;
    t.b = k + 1;
    t.prior = stepPrior(frames.reckoned[k].inverse() * frames.reckoned[k + 1]);
    steps.push_back(t);
  }
  registerAll(rig, frames, stepRules(), steps, "odometry");
  for (const Attempt& t : steps)
    if (!t.accepted()) {
      again.push_back(t);
      again.back().prior->covariance = covarianceOf(kWideSigma, kWideAngle);
    }
  registerAll(rig, frames, {}, again, "odometry, widely");
  std::vector<slam::NavigationLink> links;
  for (const auto* list : {&steps, &again})
    for (const Attempt& t : *list)
      if (t.accepted()) links.push_back(t.link);
  std::sort(links.begin(), links.end(), [](const auto& x, const auto& y) { return x.a < y.a; });
  confirm(rig, frames, links);
  return links;
}

namespace {

// False where the frame shows no ground, or the image cannot be read any more.
bool groundOf(const MissionInput& input, const Survey& survey, const Frames& frames, std::uint32_t frame,
              GroundView& view) {
  const std::optional<stereo::SeedPlane>& plane = survey.planes[frames.pair[frame]];
  if (frames.blank(frame) || !plane) return false;
  const Camera& camera = input.rig.left;
  const ImagePair& pair = survey.list.pairs[frames.pair[frame]];
  try {
    const std::vector<std::uint8_t> grey = stretchedGrey(input.image(pair, 0).view);
    view.mono = cv::Mat(camera.height, camera.width, CV_8U, const_cast<std::uint8_t*>(grey.data())).clone();
  } catch (const InputError&) {
    return false;
  }
  view.plane = {plane->normal, plane->distance};
  frames.load(frame, view.features);
  return true;
}

}  // namespace

std::vector<slam::NavigationLink> groundSteps(const MissionInput& input, const Survey& survey,
                                              const Frames& frames, std::span<const std::uint32_t> steps,
                                              bool reckoned) {
  std::vector<GroundAlignment> found(steps.size());
  rt::StageProgress progress("ground", steps.size());
  oneapi::tbb::parallel_for(std::size_t{0}, steps.size(), [&](std::size_t k) {
    GroundView a, b;
    const std::uint32_t to = steps[k], from = to - 1;
    std::optional<SE3> known;
    if (reckoned) known = frames.reckoned[from].inverse() * frames.reckoned[to];
    if (groundOf(input, survey, frames, from, a) && groundOf(input, survey, frames, to, b))
      found[k] = alignGround(input.rig.left, a, b, known);
    progress.step();
  });
  std::vector<slam::NavigationLink> links;
  for (std::size_t k = 0; k < steps.size(); ++k) {
    if (found[k].refusal != closure::Refusal::kNone) continue;
    slam::NavigationLink& link = links.emplace_back();
    link.a = steps[k] - 1;
    link.b = steps[k];
    link.T_a_b = found[k].pose.T_a_b;
    link.covariance = found[k].pose.covariance;
    link.inliers = found[k].inliers;
  }
  return links;
}

std::vector<slam::NavigationLink> withGroundSteps(const MissionInput& input, const Survey& survey,
                                                  const Frames& frames,
                                                  std::vector<slam::NavigationLink> odometry) {
  std::vector<bool> known(frames.pair.size());
  for (const slam::NavigationLink& link : odometry) known[link.b] = true;
  std::vector<std::uint32_t> bare;
  for (std::uint32_t k = 1; k < known.size(); ++k)
    if (!known[k]) bare.push_back(k);
  const std::vector<slam::NavigationLink> found = groundSteps(input, survey, frames, bare, true);
  odometry.insert(odometry.end(), found.begin(), found.end());
  std::sort(odometry.begin(), odometry.end(), [](const auto& x, const auto& y) { return x.a < y.a; });
  return odometry;
}

namespace {

constexpr double kQuietDistance = 10;     // without a closure, after which a frame is asked for [m]
constexpr double kApart = 0.5;            // of the track between two frames that are asked for, in radii
constexpr double kRecentDistance = 8;     // odometry links what is nearer well enough [m]
constexpr std::size_t kMostAsked = 4000;  // frames
constexpr std::size_t kFrameTries = 2;    // frames that one is compared with
// Of odometry over a short distance: at best, and growing with it.
constexpr double kPathSigma = 0.03, kPathAngle = 0.02, kPathDrift = 0.02;  // [m], [rad], [1]

// Frames far from any closure, by time.
std::vector<std::uint32_t> quietFrames(const Frames& frames, double radius,
                                       const std::vector<slam::NavigationLink>& links) {
  std::vector<double> closed;  // track lengths at frames with a closure
  for (const slam::NavigationLink& link : links)
    if (link.kept && !link.ofChain())
      for (const std::uint32_t end : {link.a, link.b}) closed.push_back(frames.travelled[end]);
  std::sort(closed.begin(), closed.end());
  std::vector<std::uint32_t> quiet;
  double last = -std::numeric_limits<double>::infinity();
  for (std::uint32_t k = 0; k < frames.pair.size(); ++k) {
    if (frames.blank(k) || frames.travelled[k] - last < kApart * radius) continue;
    const auto next = std::lower_bound(closed.begin(), closed.end(), frames.travelled[k] - kQuietDistance);
    if (next != closed.end() && *next < frames.travelled[k] + kQuietDistance) continue;
    last = frames.travelled[k];
    quiet.push_back(k);
  }
  const std::size_t step = quiet.size() / kMostAsked + 1;
  std::vector<std::uint32_t> asked;
  for (std::size_t k = 0; k < quiet.size(); k += step) asked.push_back(quiet[k]);
  return asked;
}

// Each with the frames before it that look most like it.
FramePairs likePairs(const Frames& frames, const std::vector<std::uint32_t>& asked) {
  if (asked.empty()) return {};
  const std::uint32_t end = asked.back() + 1;
  closure::PlaceIndexConfig config;
  config.max_places = static_cast<int>(end);
  closure::PlaceIndex places(config);
  closure::FrameFeatures features;
  FramePairs pairs;
  rt::StageProgress progress("places", end);
  for (std::uint32_t k = 0; k < end; ++k) {
    progress.step();
    if (frames.blank(k)) continue;
    frames.load(k, features);
    if (std::binary_search(asked.begin(), asked.end(), k)) {
      const auto wanted = [&](int id) {
        return frames.travelled[k] - frames.travelled[static_cast<std::size_t>(id)] > kRecentDistance;
      };
      for (const auto& place : places.query(features, kFrameTries, wanted))
        pairs.emplace_back(static_cast<std::uint32_t>(place.id), k);
    }
    (void)places.add(static_cast<int>(k), features);
  }
  return pairs;
}

// Claims of those pairs that can be registered without prior, in their order.
std::vector<closure::Claim> claimsOf(const StereoRig& rig, const Frames& frames,
                                     const std::vector<SE3>& poses, const FramePairs& pairs) {
  std::vector<Attempt> attempts = attemptsOf(pairs);
  registerAll(rig, frames, closure::recognitionRules(), attempts, "recognition");
  std::vector<closure::Claim> claims;
  for (const Attempt& t : attempts)
    if (t.accepted() && closure::fitsDownAndDepth(poses[t.a], poses[t.b], t.link.T_a_b))
      claims.push_back(closure::recognitionOf(
          static_cast<int>(t.a), static_cast<int>(t.b), {t.link.T_a_b, t.link.covariance}, t.link.inliers,
          closure::footprintOf(poses[t.b], frames.range[t.b], rig.left).radius));
  return claims;
}

// Pairs beside the claims that are not among those tried.
FramePairs besides(const Frames& frames, const std::vector<closure::Claim>& claims, const FramePairs& tried) {
  constexpr int kFarther = closure::Agreement::kNeighbours / 2;
  const std::set<FramePairs::value_type> known(tried.begin(), tried.end());
  std::set<FramePairs::value_type> pairs;
  for (const closure::Claim& claim : claims)
    for (const int da : {-kFarther, 0, kFarther})
      for (const int db : {-kFarther, 0, kFarther}) {
        const int a = claim.a + da, b = claim.b + db;
        if (a < 0 || b >= static_cast<int>(frames.pair.size()) || a >= b) continue;
        const FramePairs::value_type pair(static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b));
        if (!frames.blank(pair.first) && !frames.blank(pair.second) && !known.contains(pair))
          pairs.insert(pair);
      }
  return {pairs.begin(), pairs.end()};
}

}  // namespace

std::vector<slam::NavigationLink> recognisePlaces(const StereoRig& rig, const Frames& frames,
                                                  const slam::NavigationSolution& solution,
                                                  const std::vector<slam::NavigationLink>& links) {
  if (frames.pair.empty()) return {};
  const std::vector<SE3>& poses = solution.poses;
  const double radius = closure::footprintOf(poses[0], frames.range[0], rig.left).radius;
  FramePairs pairs = likePairs(frames, quietFrames(frames, radius, links));
  std::vector<closure::Claim> claims = claimsOf(rig, frames, poses, pairs);
  const std::vector<closure::Claim> more = claimsOf(rig, frames, poses, besides(frames, claims, pairs));
  claims.insert(claims.end(), more.begin(), more.end());
  std::sort(claims.begin(), claims.end(), [](const closure::Claim& x, const closure::Claim& y) {
    return x.b != y.b ? x.b < y.b : x.a < y.a;
  });
  const auto odometry = [&](int x, int y) {
    const auto from = static_cast<std::size_t>(x), to = static_cast<std::size_t>(y);
    const double sigma = kPathSigma + kPathDrift * std::abs(frames.travelled[to] - frames.travelled[from]);
    return closure::RelativePrior{poses[from].inverse() * poses[to], covarianceOf(sigma, kPathAngle)};
  };
  closure::Agreement agreement;
  std::vector<slam::NavigationLink> found;
  for (const closure::Claim& claim : claims)
    for (const closure::Claim& sure : agreement.add(claim, odometry)) found.push_back(linkOf(sure));
  return found;
}

}  // namespace fathom::topside
