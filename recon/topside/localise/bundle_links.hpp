#pragma once

#include <functional>
#include <vector>

#include "recon/closure/frame_features.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/solver/batch/bundle_adjustment.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "recon/topside/localise/feature_stage.hpp"

namespace fathom::topside {

// The features that each link rests on, which are not kept: every link is registered once more about its own
// result. `visit` is called one by one, in order of the links; none where that fails.
void forEachMatched(const StereoRig& rig, const Frames& frames,
                    const std::vector<slam::NavigationLink>& links,
                    const std::function<void(std::size_t link, const std::vector<closure::Match>&)>& visit);

// The left image of a pair in 8-bit grey, which is valid until the same thread asks for the next; empty where
// it cannot be read. Called by several threads at once.
using GreyImages = std::function<ImageView(std::uint32_t pair)>;

// By how much disparities are too large at a tangent of the left image [px].
using DisparityError = std::function<double(const Eigen::Vector2d& tangent)>;

struct BundledLinks {
  slam::BundleResult result;
  std::size_t links = 0;  // that were made new
};

// Bundle adjustment of all frames that `links` join, which then say what it found. Features that kept links
// joined are points, at most so many a frame that all are spread over the dive. Each is found again to a part
// of a pixel in the images themselves: about the first view's, seen through the plane of the seafloor there,
// so that errors of steps do not add up. Every image is read once, in order.
// `poses`: T_world_left by frame; `planes`: by pair. Without `images` pixels stay as the features have them.
// Disparities are taken without `error`, where it is known.
[[nodiscard]] BundledLinks bundle(const StereoRig& rig, const Frames& frames, const std::vector<SE3>& poses,
                                  const SeedPlanes& planes, const GreyImages& images,
                                  std::vector<slam::NavigationLink>& links, const DisparityError& error = {});

}  // namespace fathom::topside
