#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "recon/closure/registration.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/navigation/sensors/mounting_check.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/localise/bundle_links.hpp"
#include "recon/topside/localise/control_network.hpp"
#include "recon/topside/localise/feature_stage.hpp"
#include "recon/topside/localise/navigation_inputs.hpp"
#include "recon/topside/work/stage_store.hpp"

namespace fathom::topside {

// What simultaneous localisation and mapping made of a mission.
struct SlamResult {
  std::vector<NavigatedPose> poses;            // as navigation gave them, where they could be: improved
  std::vector<slam::NavigationLink> odometry;  // between consecutive pairs
  std::vector<slam::NavigationLink> closures;  // others, by pair
  std::size_t frames = 0;                      // pairs with features
  struct Tried {
    std::uint32_t a = 0, b = 0;  // pairs
    bool accepted = false;

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.a, self.b, self.accepted);
    }
  };
  std::vector<Tried> tried;                               // candidates for closures
  std::array<std::size_t, closure::kRefusals> refused{};  // of these, by cause
  // Track length over ground that was seen before, as BatchClosureSearch::crossings() expects it, and what of
  // it no closure verified [m].
  double crossings_expected = 0, crossings_unverified = 0;
  std::size_t unconfirmed = 0;  // closures left out: look-alikes that no other one confirmed
  bool converged = true;        // the solver, at the end
  Costs seconds;                // by part of the work
  // Of the pairs in the network (of a long dive some, evenly spread): T_nav_cam and the covariance of its
  // right perturbation (rho, phi).
  struct Uncertain {
    std::uint32_t pair = 0;
    SE3 T_nav_cam;
    Matrix6d covariance;
    Matrix6d since_first;  // of the pose seen from the first of them; zero for that

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.pair, self.T_nav_cam, self.covariance, self.since_first);
    }
  };
  std::vector<Uncertain> uncertain;
  slam::NavigationGraph::Counters sensors;  // what was noticed of the sensors
  slam::Mounting mounting;                  // the camera's turn in body axes: roll, pitch, yaw
  // What all USBL positions share, where it was sought: how they had to be shifted (north, east), and turned
  // about their middle, from above clockwise [m], [rad].
  struct Usbl {
    bool sought = false;
    Eigen::Vector2d shift = Eigen::Vector2d::Zero(), shift_sigma = Eigen::Vector2d::Zero();
    double turn = 0, turn_sigma = 0;

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.sought, self.shift, self.shift_sigma, self.turn, self.turn_sigma);
    }
  } usbl;
  std::size_t fixes_kept = 0, fixes_removed = 0;
  double moved_rms = 0;      // horizontal, of the poses against dead reckoning [m]
  std::size_t unjoined = 0;  // pairs left out: neither images nor bottom track join them to the others
  SensorTiming timing;       // as it was put right
  ImageScale scale;          // likewise, before control points
  // Of a dive without navigation: pairs that nothing joins to those of other parts, and what kept the first
  // of them from being joined to the pair before it.
  struct Part {
    std::vector<std::uint32_t> pairs;
    bool placed = false;  // files of navigation say where it is
    closure::Refusal why = closure::Refusal::kNone;

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.pairs, self.placed);
      archive.enumeration(self.why, static_cast<closure::Refusal>(closure::kRefusals - 1));
    }
  };
  std::vector<Part> parts;
  std::optional<double> refused_tilt;  // KnownPlaces' [rad]
  struct Bundled {
    bool done = false;
    std::size_t points = 0, sightings = 0, links = 0;
    double pixel_before = 0, pixel_after = 0;  // root mean square of a point's place, a coordinate [px]
    double moved_rms = 0;                      // of the cameras by it [m]

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.done, self.points, self.sightings, self.links, self.pixel_before, self.pixel_after,
              self.moved_rms);
    }
  } bundled;
  ControlResult control;
};

// `survey`, `prepared`: the contents of these results.
[[nodiscard]] Digest localiseKey(const MissionInput& input, const TopsideConfig& config, const Digest& survey,
                                 const Digest& prepared);
void saveSlam(WorkFileWriter& file, const SlamResult& slam);  // without seconds, which are not the same twice
[[nodiscard]] SlamResult loadSlam(const WorkFile& file);      // throws DamagedWork

// Visual odometry between consecutive pairs, then loop closures: candidates by the probability that
// footprints overlap, most valuable first, registered by features, in rounds: each round's poses say where
// the next one looks. Poses: slam::solveNavigation, in which dead reckoning, attitude, depth and fixes have
// their part. Control points, where there are any, at the end. The result does not depend on the number of
// threads.
[[nodiscard]] SlamResult localise(const MissionInput& input, const TopsideConfig& config,
                                  const Survey& survey, const FeatureStore& features,
                                  const GreyImages& images);

// For bundle adjustment, where config.bundle asks for it: links and poses as it finds them. `solve`: makes
// poses of links again.
[[nodiscard]] SlamResult::Bundled bundled(const StereoRig& rig, const TopsideConfig& config,
                                          const Survey& survey, const Frames& frames,
                                          const GreyImages& images, std::vector<slam::NavigationLink>& links,
                                          const std::vector<SE3>& poses, const std::function<void()>& solve,
                                          const DisparityError& error = {});

}  // namespace fathom::topside
