#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "realtime/kernel/rings/fixed_queue.hpp"
#include "realtime/onboard/localisation/keyframe_features.hpp"
#include "realtime/onboard/localisation/localisation_config.hpp"
#include "realtime/onboard/localisation/online_closure_search.hpp"
#include "recon/closure/feature_extractor.hpp"
#include "recon/geometry/pose_variance.hpp"
#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"
#include "recon/navigation/dead_reckoning/position_anchor.hpp"

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

// Simultaneous localisation and mapping on board, without threads, files or clocks: selects keyframes, links
// each to the one before by visual odometry and to older ones by loop closures, adds them to the navigation
// graph with dead reckoning and position fixes, and gives every keyframe's pose. Work per frame is bounded.
class LocalisationCore {
 public:
  // `feature_slots`: may be null; closures then reach the newest keyframes only. `rigs`: begins with the rig
  // as it was calibrated; must outlive it.
  LocalisationCore(const calibration::RigHistory& rigs, const LocalisationConfig& config,
                   SlotStore* feature_slots);
  LocalisationCore(const LocalisationCore&) = delete;
  LocalisationCore& operator=(const LocalisationCore&) = delete;

  // New calibration of the rig, for the same images. Ranges grew by (scale, per metre); if much, visual
  // odometry so far is estimated again with the new rig, one step per new keyframe; likewise when the common
  // rotation of all steps (DvlCalibration::curl()) has changed.
  void setRig(const StereoRig& rig, const Eigen::Vector2d& growth);
  // See slam::NavigationGraph::resetRig(). Visual odometry is estimated again likewise, unless the rig
  // was knocked.
  void resetRig(double turn_sigma, std::int64_t since_ns, bool knocked);
  // Shift nav - odom until the first keyframe, by fixes of a kind; for the USBL without their common error.
  void setAnchor(nav::FixKind kind, const Eigen::Vector2d& shift, double sigma);
  // A fix of an antenna at `antenna_in_odom` at its own time. It waits for the keyframe after it.
  void addFix(nav::FixKind kind, std::int64_t utc_ns, const Eigen::Vector3d& antenna_in_odom,
              const Eigen::Vector2d& north_east, double sigma);

  // A new frame at its predicted pose: if it may become a keyframe there, its features are extracted. Returns
  // its number for place(), or kNoKeyframe if it cannot become one or kLooked frames already wait.
  static constexpr int kNoKeyframe = -1;
  static constexpr std::size_t kLooked = 8;
  [[nodiscard]] int look(const LocalisationInput& input);
  // The same frame at its final odometry pose; images and features are not read. Returns the keyframe that it
  // is anchored to: itself or the one before; -1: none yet. Frames are placed in the order of look().
  int place(const LocalisationInput& input, int looked);
  // The survey is over: completes the queues, in bounded time.
  void finish();

  [[nodiscard]] int keyframes() const { return graph_.keyframes(); }  // so far
  // Of these, one that has not retired.
  [[nodiscard]] bool has(int keyframe) const { return graph_.has(keyframe); }
  // Called when a keyframe retires: what is anchored to it must be anchored to another one from now on.
  using OnRetired = std::function<void(const slam::NavigationGraph::Retired& gone)>;
  void setRetiredObserver(OnRetired observer) { on_retired_ = std::move(observer); }
  // Pose of a camera that is anchored to a keyframe by odometry.
  [[nodiscard]] SE3 poseOf(int keyframe, const SE3& T_odom_cam) const {
    return graph_.pose(keyframe) * (graph_.odometry(keyframe).inverse() * T_odom_cam);
  }
  [[nodiscard]] const SE3& keyframePose(int keyframe) const { return graph_.pose(keyframe); }
  [[nodiscard]] SE3 T_nav_odom() const { return graph_.T_nav_odom(); }
  // Horizontal standard deviation along the larger axis [m]: of the newest keyframe; and of a camera there or
  // later, by dead reckoning since.
  [[nodiscard]] double positionSigma() const { return position_sigma_; }
  [[nodiscard]] double positionSigma(std::int64_t utc_ns, const SE3& T_odom_cam,
                                     const nav::DeadReckoning::Quality& quality) const;
  // What keyframes saw, and how well they are known; takes memory, for the end of a survey.
  [[nodiscard]] std::vector<UncertainView> views();
  // Whether keyframes have moved since the last call of takeChanges().
  [[nodiscard]] bool moved() const { return graph_.changesWaiting() > 0; }
  void takeChanges() { graph_.takeAllChanges(); }

  struct Counters {
    std::uint64_t frames = 0, frames_without_features = 0;
    std::uint64_t odometry_found = 0, odometry_refused = 0, odometry_second_tries = 0, odometry_surprises = 0,
                  odometry_renewed = 0;
    std::uint64_t fixes_dropped = 0;  // for lack of room
    std::size_t fixes_waiting = 0, changes_waiting = 0;
  };
  [[nodiscard]] Counters counters() const;
  [[nodiscard]] const slam::NavigationGraph& graph() const { return graph_; }
  [[nodiscard]] const OnlineClosureSearch& closures() const { return search_; }
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

    static void exchange(auto& archive, auto& self) {
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
  [[nodiscard]] bool odometryReliable(const LocalisationInput& input) const;
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
  OnlineClosureSearch search_;
  rt::FixedQueue<Fix, kFixes> fixes_;
  slam::UsblWander usbl_wander_;
  nav::DeadReckoning::Quality last_quality_;  // at the last keyframe
  double last_unlocked_s_ = 0;                // at the last frame
  slam::LossOfTrack loss_;                    // at the last keyframe
  double position_sigma_ = 0;
  int renew_ = 0, renew_end_ = 0;  // keyframes for which visual odometry is estimated again
  int renew_from_ = 0;             // the first with the present rig
  int seen_through_ = 0;           // version of the rig, by visual odometry
  // slam::DvlCalibration::curl() then, and its standard deviations.
  Eigen::Vector4d curl_ = Eigen::Vector4d::Zero(), curl_sigma_ = Eigen::Vector4d::Zero();
  Counters counters_;
  std::function<void(const char* stage)> observer_;
  OnRetired on_retired_;
};

}  // namespace fathom::onboard
