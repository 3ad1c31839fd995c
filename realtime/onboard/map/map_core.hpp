#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "realtime/onboard/localisation/localisation_core.hpp"
#include "realtime/onboard/map/moving_map.hpp"
#include "recon/calibration/rig_watch.hpp"
#include "recon/fusion/quadtree_map.hpp"
#include "recon/geometry/colour_matrix.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/new_ground.hpp"
#include "recon/lighting/rig_ranges.hpp"
#include "recon/nav/position_anchor.hpp"
#include "recon/stereo/given_stereo.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::onboard {

struct MapCoreConfig {
  StereoRig rig;
  SE3 T_body_cam, T_body_dvl;
  PixelFormat left_format = PixelFormat::kBayerRggb;
  PixelFormat right_format = PixelFormat::kMono;
  int bits = 12;
  stereo::SparseStereoConfig stereo;
  lighting::LightingConfig lighting{.memory = lighting::kOnboardMemory};
  fusion::QuadtreeConfig map;
  int rebuild_meshes = 6;  // fused anew a pair, when keyframes have moved
  LocalisationConfig localisation;
  std::optional<Eigen::Matrix3d> colours;  // of the left camera, to sRGB: see colour_matrix.hpp
};

// Where MapCore keeps what it rarely reads; absent ones are done without.
struct MapSlots {
  SlotStore* features = nullptr;  // of keyframes: blocks of closure::slotBytes()
  SlotStore* meshes = nullptr;    // of pairs: blocks of meshSlotBytes()
};

// One stereo pair with the odometry of its exposure: two images, or what was matched in them.
struct MapInput {
  std::uint32_t pair_index = 0;
  std::int64_t utc_ns = 0;
  SE3 T_odom_body;
  nav::DeadReckoning::Quality quality;               // of the odometry up to here
  std::optional<double> altitude;                    // of the DVL above the seafloor [m]
  ImageView left, right;                             // raw, as the cameras gave them
  double left_exposure_s = 0, right_exposure_s = 0;  // as stamped; 0: not known
  const StereoFeatureFrame* features = nullptr;      // instead of images
  // This frame's work quota:
  int max_features = 0;     // of stereo; <= 0: as configured
  bool closures = true;     // false: loop closures wait
  int rebuild_meshes = -1;  // fused anew; < 0: as configured
};

// What one pair gave.
struct MapOutput {
  std::uint32_t pair_index = 0;
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;
  int keyframe = -1;            // that the pair hangs on; -1: on T_nav_odom
  SE3 T_nav_cam;                // as known when it came; MapCore::poseOf() gives the present one
  double median_range = 0;      // of the stereo points along z of the camera; 0 without points [m]
  double footprint_radius = 0;  // of the local mesh about its centre, in plan [m]
  Eigen::Vector2d min_north_east = Eigen::Vector2d::Zero();  // of the local mesh [m]
  Eigen::Vector2d max_north_east = Eigen::Vector2d::Zero();
  std::size_t points = 0, triangles = 0, nodes_updated = 0;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.instants(self.utc_ns);
    std::uint64_t points = self.points, triangles = self.triangles, nodes = self.nodes_updated;
    archive(self.pair_index, self.T_odom_cam, self.keyframe, self.T_nav_cam, self.median_range,
            self.footprint_radius, self.min_north_east, self.max_north_east, points, triangles, nodes);
    if constexpr (Archive::kLoading) {
      self.points = static_cast<std::size_t>(points);
      self.triangles = static_cast<std::size_t>(triangles);
      self.nodes_updated = static_cast<std::size_t>(nodes);
    }
  }
};

// A pair that was seen and is in the map where it was seen from, but not placed yet.
struct SeenPair {
  MapOutput output;
  double range = 0;      // to the seafloor [m]
  std::size_t slot = 0;  // of its mesh in the map, if it has triangles
  int looked = -1;       // of LocalisationCore
  bool closures = true;  // quota of the work that is left
  int rebuild_meshes = 0;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    MapOutput::exchange(archive, self.output);
    std::uint64_t slot = self.slot;
    archive(self.range, slot, self.looked, self.closures, self.rebuild_meshes);
    if constexpr (Archive::kLoading) self.slot = static_cast<std::size_t>(slot);
  }
};

// Soft real-time core without threads, files or clocks: lighting, stereo, localisation and fusion of each
// pair into the onboard map. Owns the position fixes, every keyframe's pose and T_nav_odom. Until the first
// keyframe, and without localisation for good, T_nav_odom is the shift of the fixes that came before the
// first mapped pair; without any fix nav and odom coincide and anchored() is false.
class MapCore {
 public:
  explicit MapCore(const MapCoreConfig& config, const MapSlots& slots = {});
  MapCore(const MapCore&) = delete;
  MapCore& operator=(const MapCore&) = delete;

  // A fix of an antenna or transponder that odometry has at `antenna_in_odom` at the fix's own time, with
  // `unlocked_s` of odometry then, below zero by the time before odometry began [s].
  void addFix(nav::FixKind kind, std::int64_t utc_ns, const Eigen::Vector3d& antenna_in_odom,
              const Eigen::Vector2d& north_east, double sigma, double unlocked_s = 0);
  // The pair into the map, seen from where `input` says; which may be corrected by place().
  [[nodiscard]] SeenPair see(const MapInput& input);
  // Of a pair that was seen, in the order of seeing: localisation, and what has moved by it. What the pair
  // gave, at its final place.
  MapOutput place(const SeenPair& pair, const SE3& T_odom_body, const nav::DeadReckoning::Quality& quality);
  MapOutput process(const MapInput& input) { return place(see(input), input.T_odom_body, input.quality); }
  // Whether what is in the map can be placed elsewhere.
  [[nodiscard]] bool moves() const { return localisation_ && map_.moves(); }
  // The survey is over: localisation works off what waits and the map is fused anew at the final poses.
  void finish();
  // The ship has this square as the map shows it: when the pool is full it coarsens before others.
  void noteSent(const fusion::TileKey& key) { map_.noteSent(key); }

  // Of a pair, as known now.
  [[nodiscard]] SE3 poseOf(const MapOutput& pair) const { return poseOf(pair.keyframe, pair.T_odom_cam); }
  // Called when a keyframe retires, for who holds pairs that hang on it.
  void setRetiredObserver(LocalisationCore::OnRetired observer) { on_retired_ = std::move(observer); }
  // Called where meshes in the map have moved, with the squares before and after.
  void setMovedObserver(MovingMap::OnMoved observer) { on_moved_ = std::move(observer); }
  // Called with the stage's name when it ends, for a caller that has a clock.
  void setStageObserver(std::function<void(const char* stage)> observer);

  [[nodiscard]] const SE3& T_nav_odom() const { return T_nav_odom_; }
  [[nodiscard]] bool anchored() const { return anchored_; }
  [[nodiscard]] double anchorSigma() const { return anchor_sigma_; }  // of T_nav_odom, horizontal [m]
  // Of a body there, by dead reckoning since the newest keyframe; std::nullopt before the first [m].
  [[nodiscard]] std::optional<double> positionSigma(std::int64_t utc_ns, const SE3& T_odom_body,
                                                    const nav::DeadReckoning::Quality& quality) const;
  [[nodiscard]] const nav::PositionAnchor& anchor() const { return anchor_; }
  [[nodiscard]] const fusion::QuadtreeMap& map() const { return map_.map(); }
  [[nodiscard]] const MovingMap& movingMap() const { return map_; }
  // Of a state that was loaded: whether the slots hold what it knows of them; reads all of them.
  [[nodiscard]] bool slotsHold() {
    return map_.slotsHold() && (localisation_ == nullptr || localisation_->slotsHold());
  }
  // How it stands: as it was calibrated until matches show another.
  [[nodiscard]] const calibration::RigWatch& rig() const { return rig_; }
  // Null when it is switched off.
  [[nodiscard]] const LocalisationCore* localisation() const { return localisation_.get(); }

  struct Counters {
    std::uint64_t pairs = 0, pairs_without_points = 0, bad_images = 0, points = 0;
    stereo::StereoResult::Rejected rejected;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const lighting::LightingModel& leftLight() const { return left_light_; }
  [[nodiscard]] const lighting::LightingModel& rightLight() const { return right_light_; }

  // Into one of the same configuration with the same slots: map, poses, what was learnt of the light, and all
  // counts bit by bit (map_state.cpp). One whose load() failed is of no use.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  // T_nav_odom by the fixes so far, where odometry has `unlocked_s` [s].
  void anchorAt(double unlocked_s);
  [[nodiscard]] stereo::SeedPlane seedPlane(const MapInput& input) const;
  [[nodiscard]] SE3 poseOf(int keyframe, const SE3& T_odom_cam) const;
  // Where the frame is probably; what localisation keeps of it until it is placed. `images`: it has good
  // ones, or features.
  [[nodiscard]] int look(const MapInput& input, const SeenPair& pair, bool images);
  void ended(const char* stage) const {
    if (observer_) observer_(stage);
  }
  // What `match` finds in the pair; anew where that shows that the rig stands otherwise than it was
  // calibrated.
  template <typename Match>
  const stereo::StereoResult& throughTheRig(const Match& match);
  // Points and triangles of the pair, its local mesh in the camera's frame, and features for localisation.
  const stereo::StereoResult& seeImages(const MapInput& input, const stereo::SeedPlane& plane);
  const stereo::StereoResult& seeFeatures(const MapInput& input);
  void count(const stereo::StereoResult& result);
  // What a pair's matches, and the steps between pairs, say of the rig.
  void watchRig(std::span<const RigMatch> matches, std::int64_t utc_ns);
  // Everyone who looks through the rig looks through rig_ from now on, `before` until now.
  void useRig(const StereoRig& before);
  // Corrects a pair for stereo.
  void correctPair(const MapInput& input);
  // Bends the ranges to stereo's points, learns the pair by them if it shows new ground, and corrects the
  // left image's colours anew.
  void learnLight(const MapInput& input, double range, const stereo::StereoResult& result);

  MapCoreConfig config_;
  calibration::RigWatch rig_;
  std::int64_t measured_ns_ = 0;  // the last pair of rig_'s newest measurement
  lighting::LightingModel left_light_, right_light_;
  lighting::RigRanges ranges_;
  lighting::NewGround new_ground_;
  stereo::SparseStereo stereo_;
  stereo::GivenStereo given_stereo_;
  closure::FrameFeatures given_features_;
  Mesh mesh_;  // of the pair
  MovingMap map_;
  std::unique_ptr<LocalisationCore> localisation_;
  MovingMap::OnMoved on_moved_;
  LocalisationCore::OnRetired on_retired_;
  std::function<void(const char* stage)> observer_;
  std::int64_t last_gps_ns_ = 0;
  nav::PositionAnchor anchor_;
  SE3 T_nav_odom_;
  bool frame_fixed_ = false;  // pairs have been mapped
  bool anchored_ = false;
  double anchor_sigma_ = 0;  // of T_nav_odom, horizontal [m]
  double last_range_;        // seed where the DVL has no altitude [m]
  std::optional<ColourMatrix> matrix_;
  std::vector<float> point_ranges_;  // of a pair's points; to work in
  std::vector<std::uint8_t> left_mosaic_, left_mono_, left_rgb_, right_mosaic_, right_mono_;
  std::vector<Eigen::Vector3f> points_, right_points_;  // of a pair, for the ranges
  Counters counters_;
};

}  // namespace fathom::onboard
