#include "recon/topside/localise/bundle_links.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <optional>

#include "realtime/base/numbers/union_find.hpp"
#include "realtime/base/progress.hpp"
#include "recon/closure/stereo_match.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"
#include "recon/topside/localise/batch_closure_search.hpp"
#include "recon/topside/localise/first_links.hpp"
#include "recon/topside/work/stage_runner.hpp"

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

namespace {

namespace tbb = oneapi::tbb;

constexpr std::size_t kEnough = 120;    // points of a frame
constexpr int kPatchWindow = 15;        // of a patch [px]
constexpr double kMostShift = 3;        // of a feature to where the images have it [px]
constexpr std::size_t kFewPoints = 12;  // two frames with fewer in common keep what joined them before
constexpr double kViewSpan = 5;         // over which a plane's view is differenced [px]

struct Member {
  std::uint32_t frame, feature;
};

// What is about a point in its first view.
struct Patch {
  static constexpr int kHalf = 15, kSide = 2 * kHalf + 1;
  std::array<std::uint8_t, kSide * kSide> pixels;
  Eigen::Vector2d centre;  // in it
  [[nodiscard]] ImageView view() const { return {pixels.data(), kSide, kSide, kSide, PixelFormat::kMono, 8}; }
  [[nodiscard]] bool cut(const ImageView& image, const Eigen::Vector2d& at) {
    const int x = static_cast<int>(std::lround(at.x())) - kHalf,
              y = static_cast<int>(std::lround(at.y())) - kHalf;
    if (x < 0 || y < 0 || x + kSide > image.width || y + kSide > image.height) return false;
    for (int row = 0; row < kSide; ++row)
      std::copy_n(
          static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(y + row) * image.stride + x,
          kSide, pixels.data() + static_cast<std::size_t>(row) * kSide);
    centre = at - Eigen::Vector2d(x, y);
    return true;
  }
};

class Tracks {
 public:
  Tracks(const StereoRig& rig, const Frames& frames, const std::vector<SE3>& poses, const SeedPlanes& planes)
      : rig_(rig), frames_(frames), poses_(poses), planes_(planes) {}

  // Points that links join, of at least two frames, those of most frames first.
  void join(const std::vector<slam::NavigationLink>& links) {
    std::vector<std::uint32_t> first{0};
    for (const std::uint32_t pair : frames_.pair)
      first.push_back(first.back() + static_cast<std::uint32_t>(frames_.features->count(pair)));
    UnionFind sets(first.back());
    std::vector<slam::NavigationLink> kept;
    for (const slam::NavigationLink& link : links)
      if (link.kept) kept.push_back(link);
    forEachMatched(rig_, frames_, kept, [&](std::size_t k, const std::vector<closure::Match>& matches) {
      for (const closure::Match& m : matches)
        sets.join(first[kept[k].a] + static_cast<std::uint32_t>(m.a),
                  first[kept[k].b] + static_cast<std::uint32_t>(m.b));
    });
    std::vector<std::pair<std::uint32_t, std::uint32_t>> all;  // root, feature
    for (std::uint32_t f = 0; f < first.back(); ++f)
      if (sets.root(f) != f) all.emplace_back(sets.root(f), f);
    std::sort(all.begin(), all.end());
    std::vector<std::vector<Member>> tracks;
    const auto memberOf = [&](std::uint32_t f) {
      const auto frame =
          static_cast<std::uint32_t>(std::upper_bound(first.begin(), first.end(), f) - first.begin() - 1);
      return Member{frame, f - first[frame]};
    };
    for (std::size_t k = 0; k < all.size();) {
      std::vector<Member> track{memberOf(all[k].first)};
      const std::uint32_t root = all[k].first;
      for (; k < all.size() && all[k].first == root; ++k) track.push_back(memberOf(all[k].second));
      const bool twice = std::adjacent_find(track.begin(), track.end(), [](const Member& x, const Member& y) {
                           return x.frame == y.frame;
                         }) != track.end();
      if (!twice) tracks.push_back(std::move(track));
    }
    std::stable_sort(tracks.begin(), tracks.end(),
                     [](const auto& x, const auto& y) { return x.size() > y.size(); });
    std::vector<std::size_t> have(frames_.pair.size(), 0);
    for (std::vector<Member>& track : tracks) {
      if (std::none_of(track.begin(), track.end(), [&](const Member& m) { return have[m.frame] < kEnough; }))
        continue;
      for (const Member& m : track) ++have[m.frame];
      tracks_.push_back(std::move(track));
    }
    by_frame_.resize(frames_.pair.size());
    for (std::uint32_t t = 0; t < tracks_.size(); ++t)
      for (std::uint32_t i = 0; i < tracks_[t].size(); ++i) by_frame_[tracks_[t][i].frame].push_back({t, i});
    sightings_.resize(tracks_.size());
    for (std::size_t t = 0; t < tracks_.size(); ++t) sightings_[t].resize(tracks_[t].size());
  }

  // Where every point is seen, in order of frames.
  void see(const GreyImages& images) {
    const std::size_t at_once = 4 * threadsAllowed();
    patches_.resize(tracks_.size());
    rt::StageProgress progress("points", frames_.pair.size());
    for (std::size_t first = 0; first < frames_.pair.size(); first += at_once) {
      const std::size_t end = std::min(frames_.pair.size(), first + at_once);
      std::vector<std::vector<std::uint8_t>> grey(end - first);
      tbb::parallel_for(first, end, [&](std::size_t k) {
        seeFirst(static_cast<std::uint32_t>(k), images, grey[k - first]);
      });
      tbb::parallel_for(first, end, [&](std::size_t k) {
        if (!grey[k - first].empty()) seeAgain(static_cast<std::uint32_t>(k), viewOf(grey[k - first]));
        progress.step();
      });
      for (std::size_t k = first; k < end; ++k)
        for (const auto& [t, i] : by_frame_[k])
          if (i + 1 == tracks_[t].size()) patches_[t].reset();
    }
  }

  // Points that two frames or more see, without that error of their disparities.
  void give(slam::Bundle& bundle, const DisparityError& error) const {
    bundle.first = {0};
    for (const auto& track : sightings_) {
      const auto seen =
          std::count_if(track.begin(), track.end(), [](const auto& s) { return s.left.x() >= 0; });
      if (seen < 2) continue;
      for (slam::Bundle::Sighting s : track) {
        if (s.left.x() < 0) continue;
        if (error)
          s.right.x() += static_cast<float>(error(rig_.left.ray(s.left.cast<double>()).hnormalized()));
        bundle.sightings.push_back(s);
      }
      bundle.first.push_back(static_cast<std::uint32_t>(bundle.sightings.size()));
    }
  }

 private:
  [[nodiscard]] ImageView viewOf(const std::vector<std::uint8_t>& grey) const {
    return {grey.data(),        rig_.left.width,
            rig_.left.height,   static_cast<std::size_t>(rig_.left.width),
            PixelFormat::kMono, 8};
  }

  void seeFirst(std::uint32_t frame, const GreyImages& images, std::vector<std::uint8_t>& grey) {
    for (const auto& [t, i] : by_frame_[frame]) sightings_[t][i] = {frame, Eigen::Vector2f::Constant(-1)};
    if (by_frame_[frame].empty()) return;
    closure::FrameFeatures features;
    frames_.load(frame, features);
    if (images) {
      const ImageView image = images(frames_.pair[frame]);
      if (image.data == nullptr) return;
      grey.resize(static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height));
      for (int row = 0; row < image.height; ++row)
        std::copy_n(
            static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(row) * image.stride,
            image.width, grey.data() + static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width));
    }
    for (const auto& [t, i] : by_frame_[frame]) {
      const closure::Feature& f = features.features[tracks_[t][i].feature];
      slam::Bundle::Sighting& s = sightings_[t][i];
      s.left = f.left;
      s.right = f.right;
      if (!images || i > 0) continue;
      patches_[t] = std::make_unique<Patch>();
      if (!patches_[t]->cut(viewOf(grey), f.left.cast<double>())) {
        patches_[t].reset();
        s.left.setConstant(-1);
      }
    }
  }

  void seeAgain(std::uint32_t frame, const ImageView& image) {
    closure::PatchAligner aligner(kPatchWindow);
    for (const auto& [t, i] : by_frame_[frame]) {
      if (i == 0) continue;
      slam::Bundle::Sighting& s = sightings_[t][i];
      const slam::Bundle::Sighting& of_first = sightings_[t][0];
      Eigen::Vector2d at = s.left.cast<double>();
      Eigen::Matrix2d covariance;
      const std::optional<Eigen::Matrix2d> warp = patches_[t] ? warpOf(of_first, frame) : std::nullopt;
      if (warp && aligner.take(patches_[t]->view(), patches_[t]->centre, *warp) &&
          aligner.find(image, kMostShift, at, covariance)) {
        s.right += at.cast<float>() - s.left;
        s.left = at.cast<float>();
      } else {
        s.left.setConstant(-1);
      }
    }
  }

  // Of the first view's pixels by another frame's, on the plane of the seafloor through the point.
  [[nodiscard]] std::optional<Eigen::Matrix2d> warpOf(const slam::Bundle::Sighting& first,
                                                      std::uint32_t frame) const {
    const auto& plane = planes_[frames_.pair[first.view]];
    const Eigen::Vector2d pixel = first.left.cast<double>();
    Eigen::Vector3d point;
    double gap = 0;
    if (!plane || !triangulatePixels(rig_, pixel, first.right.cast<double>(), point, gap)) return {};
    const SE3 T_there_here = poses_[frame].inverse() * poses_[first.view];
    Eigen::Matrix2d there;
    for (int i = 0; i < 2; ++i) {
      std::array<Eigen::Vector2d, 2> ends;
      for (const int side : {0, 1}) {
        const Eigen::Vector3d ray =
            rig_.left.ray(pixel + (side == 0 ? -kViewSpan : kViewSpan) * Eigen::Vector2d::Unit(i));
        const Eigen::Vector3d p = T_there_here * (ray * (plane->normal.dot(point) / plane->normal.dot(ray)));
        if (!(p.z() > 0)) return {};
        ends[static_cast<std::size_t>(side)] = rig_.left.project(p);
      }
      there.col(i) = (ends[1] - ends[0]) / (2 * kViewSpan);
    }
    const Eigen::Matrix2d here = there.inverse();
    if (!here.allFinite()) return {};
    return here;
  }

  const StereoRig& rig_;
  const Frames& frames_;
  const std::vector<SE3>& poses_;
  const SeedPlanes& planes_;
  std::vector<std::vector<Member>> tracks_;
  std::vector<std::vector<std::pair<std::uint32_t, std::uint32_t>>>
      by_frame_;                                                // point, and which of its views
  std::vector<std::vector<slam::Bundle::Sighting>> sightings_;  // left.x() < 0: not seen
  std::vector<std::unique_ptr<Patch>> patches_;                 // until the last view
};

// Of two frames each, the points in common.
std::map<std::pair<std::uint32_t, std::uint32_t>, std::size_t> inCommon(const slam::Bundle& bundle) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::size_t> common;
  for (std::size_t p = 0; p + 1 < bundle.first.size(); ++p)
    for (std::uint32_t i = bundle.first[p]; i < bundle.first[p + 1]; ++i)
      for (std::uint32_t j = i + 1; j < bundle.first[p + 1]; ++j)
        ++common[{bundle.sightings[i].view, bundle.sightings[j].view}];
  return common;
}

}  // namespace

BundledLinks bundle(const StereoRig& rig, const Frames& frames, const std::vector<SE3>& poses,
                    const SeedPlanes& planes, const GreyImages& images,
                    std::vector<slam::NavigationLink>& links, const DisparityError& error) {
  BundledLinks out;
  slam::Bundle bundle;
  bundle.rig = rig;
  bundle.graph.poses = poses;
  for (std::uint32_t k = 0; k < poses.size(); ++k) {
    bundle.graph.ids.push_back(k);
    bundle.nodes.push_back(static_cast<int>(k));
  }
  {
    Tracks tracks(rig, frames, poses, planes);
    tracks.join(links);
    tracks.see(images);
    tracks.give(bundle, error);
  }
  const auto common = inCommon(bundle);
  const auto enough = [&](const slam::NavigationLink& link) {
    const auto found = common.find({std::min(link.a, link.b), std::max(link.a, link.b)});
    return found != common.end() && found->second >= kFewPoints;
  };
  for (const slam::NavigationLink& link : links)
    if (link.kept && !enough(link))
      bundle.graph.edges.push_back(
          slam::linkFactor(static_cast<int>(link.a), static_cast<int>(link.b), link.T_a_b, link.covariance));
  out.result = slam::adjust(bundle, {}, [](std::size_t begin, std::size_t end, const auto& one) {
    tbb::parallel_for(begin, end, one);
  });
  if (!out.result.converged) return out;
  for (slam::NavigationLink& link : links) {
    if (!link.kept || !enough(link)) continue;
    link.T_a_b = bundle.graph.poses[link.a].inverse() * bundle.graph.poses[link.b];
    ++out.links;
  }
  return out;
}

}  // namespace fathom::topside
