#include "recon/topside/localise/ground_steps.hpp"

#include <oneapi/tbb/parallel_for.h>

#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "recon/topside/localise/ground_alignment.hpp"

namespace fathom::topside {
namespace {

// False where the image cannot be read any more.
bool groundOf(const MissionInput& input, const Survey& survey, const Frames& frames, std::uint32_t frame,
              GroundView& view) {
  const Camera& camera = input.rig.left;
  const ImagePair& pair = survey.list.pairs[frames.pair[frame]];
  try {
    const std::vector<std::uint8_t> grey = stretchedGrey(input.image(pair, 0).view);
    view.mono = cv::Mat(camera.height, camera.width, CV_8U, const_cast<std::uint8_t*>(grey.data())).clone();
  } catch (const InputError&) {
    return false;
  }
  const stereo::SeedPlane& plane = *survey.planes[frames.pair[frame]];
  view.plane = {plane.normal, plane.distance};
  frames.load(frame, view.features);
  return true;
}

}  // namespace

std::vector<slam::NavigationLink> groundSteps(const MissionInput& input, const Survey& survey,
                                              const Frames& frames, std::span<const std::uint32_t> steps) {
  std::vector<GroundAlignment> found(steps.size());
  rt::StageProgress progress("ground", steps.size());
  oneapi::tbb::parallel_for(std::size_t{0}, steps.size(), [&](std::size_t k) {
    GroundView a, b;
    if (groundOf(input, survey, frames, steps[k] - 1, a) && groundOf(input, survey, frames, steps[k], b))
      found[k] = alignGround(input.rig.left, a, b);
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

}  // namespace fathom::topside
