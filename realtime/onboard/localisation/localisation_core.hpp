#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "realtime/kernel/fixed_queue.hpp"
#include "realtime/onboard/localisation/closure_search.hpp"
#include "realtime/onboard/localisation/keyframe_features.hpp"
#include "realtime/onboard/localisation/keyframe_selection.hpp"
#include "realtime/onboard/localisation/localisation_config.hpp"
#include "recon/closure/feature_extractor.hpp"
#include "recon/nav/dead_reckoning.hpp"
#include "recon/nav/position_anchor.hpp"

namespace fathom::onboard {

// Where features are sought when the seafloor is `range` away [m].
[[nodiscard]] closure::DepthRange depthsAbout(double range);

// One stereo frame as localisation sees it.
struct LocalisationInput {
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;
  nav::DeadReckoning::Quality quality;               // of dead reckoning up to here
  double range = 2;                                  // to the seafloor along the camera's axis [m]
  ImageView left, right;                             // 8-bit mono, lighting corrected; empty: none
  const closure::FrameFeatures* features = nullptr;  // found already, instead of images
  bool closures = true;                              // false: candidates for closures wait
};

// Simultaneous localisation and mapping on board, without threads, files or clocks: chooses keyframes, links
// each to the one before by visual odometry and to older ones by loop closures, gives them to the navigation
// graph with dead reckoning and position fixes, and says where every keyframe is. Work is bounded a frame.
class LocalisationCore {
 public:
  // `feature_slots`: may be null; closures then reach the newest keyframes only. `rigs`: begins with the rig
  // as it was calibrated; must outlive it.
  LocalisationCore(const calibration::RigHistory& rigs, const LocalisationConfig& config,
                   SlotStore* feature_slots);
  LocalisationCore(const LocalisationCore&) = delete;
  LocalisationCore& operator=(const LocalisationCore&) = delete;

  // As the rig stands from now on; of the same images. Ranges through it grew by (scale, per metre); where
  // they have by much, visual odometry up to here is sought anew through it, a step for each keyframe that
  // comes. So it is when the turn that all steps share (DvlCalibration::curl()) has become another.
  void setRig(const StereoRig& rig, const Eigen::Vector2d& growth);
  // slam::NavigationGraph::rigBeganAnew(). Visual odometry is sought anew likewise, unless the rig stood
  // otherwise before.
  void rigBeganAnew(double turn_sigma, std::int64_t since_ns, bool knocked);
  // Where odom's origin is as long as there is no keyframe (nav - odom), by fixes of a kind; of the USBL's
  // without what they share.
  void setAnchor(nav::FixKind kind, const Eigen::Vector2d& shift, double sigma);
  // A fix of an antenna at `antenna_in_odom` at its own time. It waits for the keyframe after it.
  void addFix(nav::FixKind kind, std::int64_t utc_ns, const Eigen::Vector3d& antenna_in_odom,
              const Eigen::Vector2d& north_east, double sigma);

  // A frame as soon as there is one, where the vehicle probably was: if it may become a keyframe there, its
  // features are found. Its number for place(); kNoKeyframe: it becomes none, as also when kLooked of them
  // wait.
  static constexpr int kNoKeyframe = -1;
  static constexpr std::size_t kLooked = 8;
  [[nodiscard]] int look(const LocalisationInput& input);
  // The same frame where odometry has it for good; images and features are not looked at. The keyframe that
  // it hangs on: itself or the one before. -1: none yet. Frames are placed in the order in which they were
  // looked at.
  int place(const LocalisationInput& input, int looked);
  // The survey is over: what waits is worked off, in bounded time.
  void finish();

  [[nodiscard]] int keyframes() const { return graph_.keyframes(); }  // so far
  // Of these, one that has not retired.
  [[nodiscard]] bool has(int keyframe) const { return graph_.has(keyframe); }
  // Called when a keyframe retires: what hangs on it must hang on another one, where it is, from now on.
  using OnRetired = std::function<void(const slam::NavigationGraph::Retired& gone)>;
  void setRetiredObserver(OnRetired observer) { on_retired_ = std::move(observer); }
  // Of a camera that hangs on a keyframe by odometry.
  [[nodiscard]] SE3 poseOf(int keyframe, const SE3& T_odom_cam) const {
    return graph_.pose(keyframe) * (graph_.odometry(keyframe).inverse() * T_odom_cam);
  }
  [[nodiscard]] const SE3& keyframePose(int keyframe) const { return graph_.pose(keyframe); }
  [[nodiscard]] SE3 T_nav_odom() const { return graph_.T_nav_odom(); }
  // Of the newest keyframe, horizontal, the larger axis [m]; and of a camera there or later, by dead
  // reckoning since.
  [[nodiscard]] double positionSigma() const { return position_sigma_; }
  [[nodiscard]] double positionSigma(std::int64_t utc_ns, const SE3& T_odom_cam,
                                     const nav::DeadReckoning::Quality& quality) const;
  // Whether keyframes have moved since the last call of takeChanges().
  [[nodiscard]] bool moved() const { return graph_.changesWaiting() > 0; }
  void takeChanges() { graph_.takeAllChanges(); }

  struct Counters {
    std::uint64_t frames = 0, frames_without_features = 0;
    std::uint64_t odometry_found = 0, odometry_refused = 0, odometry_second_tries = 0, odometry_surprises = 0,
                  odometry_renewed = 0;
    std::uint64_t fixes_dropped = 0;  // for want of room
    std::size_t fixes_waiting = 0, changes_waiting = 0;
  };
  [[nodiscard]] Counters counters() const;
  [[nodiscard]] const slam::NavigationGraph& graph() const { return graph_; }
  [[nodiscard]] const ClosureSearch& closures() const { return search_; }
  [[nodiscard]] const KeyframeFeatures& features() const { return features_; }
  [[nodiscard]] bool slotsHold() { return features_.slotsHold(); }
  [[nodiscard]] std::size_t memoryBytes() const;

  // Into one of the same configuration with the same slots: every keyframe's pose bit by bit. One whose
  // load() failed is of no use.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

  // Called with the stage's name when it ends: "features", "visual odometry", "graph", "candidates",
  // "closures". For a caller that has a clock.
  void setStageObserver(std::function<void(const char* stage)> observer) { observer_ = std::move(observer); }

 private:
  struct Fix {
    nav::FixKind kind = nav::FixKind::kGps;
    std::int64_t utc_ns = 0;
    Eigen::Vector3d antenna = Eigen::Vector3d::Zero();
    Eigen::Vector2d north_east = Eigen::Vector2d::Zero();
    double sigma = 1;

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive.enumeration(self.kind, nav::FixKind::kUsbl);
      archive(self.utc_ns, self.antenna, self.north_east, self.sigma);
    }
  };
  struct Looked {
    bool waits = false;
    int rig = 0;  // version of it that the features were seen through
    closure::FrameFeatures features;
  };
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  void ended(const char* stage) const {
    if (observer_) observer_(stage);
  }
  [[nodiscard]] bool trusted(const LocalisationInput& input) const;
  [[nodiscard]] closure::Footprint footprintOf(const LocalisationInput& input) const;
  void addKeyframe(const LocalisationInput& input, const Looked& looked);
  void noteRetired();
  void linkToLast(const slam::KeyframeInput& input);
  void noteCurl();
  void renewIfCurlIsAnother();
  void renewLinks();
  void renewLink();
  [[nodiscard]] bool confirms(int keyframe, int newest, const UncertainPose& link);
  void applyFixes(bool all);
  [[nodiscard]] int nearestKeyframe(std::int64_t utc_ns) const;

  static constexpr std::size_t kFixes = 64;
  LocalisationConfig config_;
  const calibration::RigHistory& rigs_;
  Camera camera_;
  KeyframeSelection selection_;
  closure::FeatureExtractor extractor_;
  closure::Registrar near_, far_;  // for visual odometry: with dead reckoning as prior, and against it
  std::array<Looked, kLooked> looked_;
  KeyframeFeatures features_;
  slam::NavigationGraph graph_;
  ClosureSearch search_;
  rt::FixedQueue<Fix, kFixes> fixes_;
  nav::DeadReckoning::Quality last_quality_;  // at the last keyframe
  double last_unlocked_s_ = 0;                // at the last frame
  slam::LossOfTrack loss_;                    // at the last keyframe
  double position_sigma_ = 0;
  int renew_ = 0, renew_end_ = 0;  // keyframes to which visual odometry is sought anew
  int renew_from_ = 0;             // the first that saw through the rig as it stands
  int seen_through_ = 0;           // version of the rig, by visual odometry
  // slam::DvlCalibration::curl() then, and its standard deviations.
  Eigen::Vector4d curl_ = Eigen::Vector4d::Zero(), curl_sigma_ = Eigen::Vector4d::Zero();
  Counters counters_;
  std::function<void(const char* stage)> observer_;
  OnRetired on_retired_;
};

}  // namespace fathom::onboard
