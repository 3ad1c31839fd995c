#include "recon/topside/localise/visual_odometry.hpp"

#include <algorithm>

#include "recon/geometry/uncertain_pose.hpp"
#include "recon/topside/localise/batch_closure_search.hpp"

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

}  // namespace fathom::topside
