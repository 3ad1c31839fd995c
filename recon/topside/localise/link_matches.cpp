#include "recon/topside/localise/link_matches.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <memory>

#include "realtime/base/progress.hpp"
#include "recon/topside/localise/batch_closure_search.hpp"
#include "recon/topside/localise/visual_odometry.hpp"

namespace fathom::topside {

void forEachMatched(const StereoRig& rig, const Frames& frames,
                    const std::vector<slam::NavigationLink>& links,
                    const std::function<void(std::size_t, const std::vector<closure::Match>&)>& visit) {
  namespace tbb = oneapi::tbb;
  // Of the prior that the link's own pose is: a step of dead reckoning.
  constexpr double kSigma = 0.05, kAngle = 0.02;  // [m], [rad]
  constexpr std::size_t kAtOnce = 1024;
  tbb::enumerable_thread_specific<std::unique_ptr<closure::Registrar>> registrars;
  rt::StageProgress progress("matches", links.size());
  std::vector<std::vector<closure::Match>> matches(std::min(kAtOnce, links.size()));
  for (std::size_t first = 0; first < links.size(); first += kAtOnce) {
    const std::size_t end = std::min(links.size(), first + kAtOnce);
    tbb::parallel_for(first, end, [&](std::size_t k) {
      auto& registrar = registrars.local();
      if (!registrar) registrar = std::make_unique<closure::Registrar>(rig, stepRules());
      closure::FrameFeatures a, b;
      frames.load(links[k].a, a);
      frames.load(links[k].b, b);
      const closure::Registration& found =
          registrar->process(a, b, closure::RelativePrior{links[k].T_a_b, covarianceOf(kSigma, kAngle)});
      matches[k - first].clear();
      if (found.accepted()) matches[k - first] = found.inliers;
      progress.step();
    });
    for (std::size_t k = first; k < end; ++k) visit(k, matches[k - first]);
  }
}

}  // namespace fathom::topside
