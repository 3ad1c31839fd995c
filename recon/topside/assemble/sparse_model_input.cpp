#include "recon/topside/assemble/assemble.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "recon/products/exports/sparse_model.hpp"
#include "recon/topside/light/pair_images.hpp"
#include "recon/topside/localise/bundle_links.hpp"

namespace fathom::topside {
namespace {

namespace tbb = oneapi::tbb;

constexpr std::uint32_t kNoView = ~0U;

// `pair_of`: each view's pair.
std::vector<ViewMatches> viewMatchesOf(const StereoRig& rig, const PreparedGroups& groups,
                                       const SlamResult& slam, const std::vector<std::uint32_t>& view_of,
                                       const std::vector<std::uint32_t>& pair_of) {
  Frames views;
  views.features = &groups;
  views.pair = pair_of;
  std::vector<slam::NavigationLink> links;
  for (const auto* list : {&slam.odometry, &slam.closures})
    for (slam::NavigationLink link : *list) {
      if (!link.kept || view_of[link.a] == kNoView || view_of[link.b] == kNoView) continue;
      link.a = view_of[link.a];
      link.b = view_of[link.b];
      links.push_back(link);
    }
  std::vector<ViewMatches> out;
  forEachMatched(rig, views, links, [&](std::size_t k, const std::vector<closure::Match>& matches) {
    out.push_back({links[k].a, links[k].b, matches});
  });
  return out;
}

// Of every point, from the left image of its first view.
void colour(Dive& dive, const std::vector<std::uint32_t>& pair_of, SparseModel& model) {
  const LightingModels& lighting = dive.lighting();
  const SeedPlanes planes = dive.planes();
  tbb::enumerable_thread_specific<std::unique_ptr<PairImages>> images;
  rt::StageProgress progress("colours", model.views.size());
  tbb::parallel_for(std::uint32_t{0}, static_cast<std::uint32_t>(model.views.size()), [&](std::uint32_t v) {
    auto& image = images.local();
    if (!image) image = std::make_unique<PairImages>(dive.input(), lighting);
    const StereoView& view = model.views[v];
    const auto& plane = planes[pair_of[v]];
    if (!view.features.empty() && plane && image->readLeft(dive.survey().list.pairs[pair_of[v]])) {
      std::vector<Eigen::Vector3f> ground;
      for (const closure::Feature& feature : view.features) ground.push_back(feature.point);
      const RgbImage rgb = image->colours(*plane, ground);
      for (std::size_t k = 0; k < view.features.size(); ++k) {
        SparsePoint& point = model.points[view.point_of[k]];
        if (model.members[point.first].view != v) continue;
        const Eigen::Vector2f& pixel = view.features[k].left;
        const std::uint8_t* c =
            rgb.at(std::clamp(static_cast<int>(std::lround(pixel.x())), 0, rgb.width - 1),
                   std::clamp(static_cast<int>(std::lround(pixel.y())), 0, rgb.height - 1));
        point.colour = {c[0], c[1], c[2]};
      }
    }
    progress.step();
  });
}

}  // namespace

SparseModel sparseModelOf(Dive& dive) {
  const MissionInput& input = dive.input();
  if (input.features_only)
    throw InputError(input.paths.root.string(), "img",
                     "has no images: the mission is made of features alone");
  SparseModel model;
  const SlamResult* slam = dive.localised();
  model.origin = input.origin();
  model.placed_by = input.given_poses ? "poses that were given" : dive.survey().navigation.anchor.source;
  model.rig = input.rig;
  const std::vector<NavigatedPose>& poses = dive.poses();
  const PreparedGroups& groups = dive.prepared();
  std::vector<std::uint32_t> view_of(poses.size(), kNoView), pair_of;
  for (std::uint32_t k = 0; k < poses.size(); ++k) {
    const PairFacts& facts = groups.facts()[k];
    if (!poses[k].T_nav_body || !facts.placed || !facts.unreadable.empty()) continue;
    const ImagePair& pair = dive.survey().list.pairs[k];
    StereoView view{
        pair.left, pair.right, worldFromNav() * *poses[k].T_nav_body * input.mission.T_body_cam, {}, {}};
    if (slam != nullptr && groups.count(k) > 0) {
      closure::FrameFeatures frame;
      groups.load(k, frame);
      view.features = std::move(frame.features);
    }
    view_of[k] = static_cast<std::uint32_t>(model.views.size());
    pair_of.push_back(k);
    model.views.push_back(std::move(view));
  }
  if (model.views.empty()) throw InputError(input.paths.root.string(), "img", "no pair has a pose");
  std::vector<ViewMatches> matches;
  if (slam != nullptr) matches = viewMatchesOf(input.rig, groups, *slam, view_of, pair_of);
  joinFeatures(matches, model);
  if (!model.points.empty()) colour(dive, pair_of, model);
  return model;
}

}  // namespace fathom::topside
