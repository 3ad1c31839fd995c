#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "realtime/base/numbers/union_find.hpp"
#include "recon/closure/candidates.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/localise/control_network.hpp"
#include "recon/topside/localise/feature_stage.hpp"
#include "recon/topside/localise/known_places.hpp"
#include "recon/topside/localise/slam_stage.hpp"

namespace fathom::topside {

// The camera poses of a dive without a track, joined by links: solves them, and places the parts into which
// they fall. Frames are the pairs that have features and a plane of the seafloor. Poses are of the left
// camera, in a frame of each part's own until arrange().
class FreeNetwork {
 public:
  // Frames that links join, by their first.
  struct Part {
    std::vector<std::uint32_t> frames;
    bool placed = false;  // navigation or control points give its place
  };

  FreeNetwork(const MissionInput& input, const Survey& survey, const FeatureStore& features);

  std::vector<slam::NavigationLink> links;  // by frame

  [[nodiscard]] const Frames& frames() const { return frames_; }
  [[nodiscard]] std::vector<SE3>& poses() { return poses_; }
  [[nodiscard]] const std::vector<SE3>& poses() const { return poses_; }
  [[nodiscard]] const KnownPlaces& places() const { return places_; }
  [[nodiscard]] bool converged() const { return converged_; }
  [[nodiscard]] bool inOnePart(std::uint32_t a, std::uint32_t b) { return parts_.root(a) == parts_.root(b); }
  [[nodiscard]] closure::Footprint footprint(std::uint32_t frame) const;

  // Maximum likelihood poses by the links. Closures that contradict the others beyond 99.9 % of chi-square
  // are taken out, the worst first.
  void solve();
  // Levels the parts: where navigation has them, the others beside, east of all.
  std::vector<Part> arrange();
  // Moves arranged parts to control points, at the scale that these and scale bars give.
  ControlResult hold(ControlNetwork& control, std::vector<Part>& parts, double scale_sigma);

 private:
  KnownPlaces framesOf(const MissionInput& input, const Survey& survey, const FeatureStore& features);
  [[nodiscard]] slam::PoseGraph linked() const;  // of the links that are kept
  // The network of arranged parts in nav, solved with navigation.
  KnownPlaces::Placed placed(const std::vector<Part>& parts);
  void takePoses(const slam::PoseGraph& in_nav);
  // Moves the parts without a place east of the others.
  void standApart(const std::vector<Part>& parts);
  // Moves a part without a place east of `edge`; returns the eastern edge of all so far [m].
  double standAside(const Part& part, std::optional<double> edge);

  const StereoRig& rig_;
  Frames frames_;
  KnownPlaces places_;
  std::vector<SE3> poses_;
  UnionFind parts_;
  bool converged_ = true;
};

// Poses of a dive from its images: visual odometry between consecutive pairs (over one that shows too little,
// if need be; where there are no features, from all pixels of level ground, alignGround(); where there is
// nothing to see, by velocities and attitudes), places recognised (closure::PlaceIndex, closure::Agreement),
// pairs that overlap by the poses found so far; maximum likelihood of all, closures that contradict the
// others taken out. Where nothing joins pairs, the dive falls into parts (SlamResult::parts), the first
// pair's first. What files of navigation know (Survey::known) places and levels them (KnownPlaces); without,
// a part is level on the seafloor that it shows, with its first camera at depth 0 and the top of that image
// to the north, and stands east of the part before it. The result does not depend on the number of threads.
[[nodiscard]] SlamResult localiseFreely(const MissionInput& input, const TopsideConfig& config,
                                        const Survey& survey, const FeatureStore& features,
                                        const GreyImages& images);

}  // namespace fathom::topside
