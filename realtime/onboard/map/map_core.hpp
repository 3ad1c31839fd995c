#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "realtime/onboard/localisation/localisation_core.hpp"
#include "realtime/onboard/map/moving_map.hpp"
#include "recon/calibration/rig_history.hpp"
#include "recon/fusion/quadtree_map.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/range_lattice.hpp"
#include "recon/navigation/dead_reckoning/position_anchor.hpp"
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
  int rebuild_meshes = 6;  // fused again per pair, when keyframes have moved
  LocalisationConfig localisation;
  std::optional<Eigen::Matrix3d> colours;  // of the left camera, to sRGB: see colour.hpp
};

// Storage of MapCore outside memory; each is optional.
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
  int rebuild_meshes = -1;  // fused again; < 0: as configured
};

// What one pair gave.
struct MapOutput {
  std::uint32_t pair_index = 0;
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;
  int keyframe = -1;            // that the pair is anchored to; -1: to T_nav_odom
  SE3 T_nav_cam;                // estimate when the pair was placed; MapCore::poseOf() gives the present one
  double median_range = 0;      // of the stereo points along z of the camera; 0 without points [m]
  double footprint_radius = 0;  // of the local mesh about its centre, in plan [m]
  Eigen::Vector2d min_north_east = Eigen::Vector2d::Zero();  // of its box in nav, as predicted [m]
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

// A pair that is in the map at its predicted pose and has no final pose yet.
struct SeenPair {
  MapOutput output;
  double range = 0;      // to the seafloor [m]
  std::size_t slot = 0;  // of its mesh in the map, if it has triangles
  int looked = -1;       // number by LocalisationCore::look(), for place(); -1: cannot become a keyframe
  bool closures = true;  // work quota for place(), from MapInput
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
// keyframe, and always without localisation, T_nav_odom is the shift by the fixes before the first mapped
// pair; without any fix nav and odom coincide and anchored() is false.
class MapCore {
 public:
  explicit MapCore(const MapCoreConfig& config, const MapSlots& slots = {});
  MapCore(const MapCore&) = delete;
  MapCore& operator=(const MapCore&) = delete;

  // A fix of an antenna or transponder at `antenna_in_odom` at the time of the fix; `unlocked_s`: time that
  // odometry had then been without bottom lock, negative by the time before odometry began [s].
  void addFix(nav::FixKind kind, std::int64_t utc_ns, const Eigen::Vector3d& antenna_in_odom,
              const Eigen::Vector2d& north_east, double sigma, double unlocked_s = 0);
  // Adds the pair to the map at the pose in `input`, which place() may correct.
  [[nodiscard]] SeenPair see(const MapInput& input);
  // Places a pair of see(), in the same order, at its final pose: localisation, and the moves that it causes.
  MapOutput place(const SeenPair& pair, const SE3& T_odom_body, const nav::DeadReckoning::Quality& quality);
  MapOutput process(const MapInput& input) { return place(see(input), input.T_odom_body, input.quality); }
  // Whether meshes in the map can move.
  [[nodiscard]] bool moves() const { return localisation_ && map_.moves(); }
  // The survey is over: localisation completes its queue and the map is fused again at the final poses.
  void finish();
  // The whole map, with the standard deviation of its places in nav where localisation knows them; takes
  // memory, for the end of a survey.
  [[nodiscard]] Mesh mesh();
  // The ship holds this square in its present state: it is coarsened before others when the pool is full.
  void noteSent(const fusion::TileKey& key) { map_.noteSent(key); }

  // Present pose of a pair's camera.
  [[nodiscard]] SE3 poseOf(const MapOutput& pair) const { return poseOf(pair.keyframe, pair.T_odom_cam); }
  // Called when a keyframe retires, for the owner of pairs that are anchored to it.
  void setRetiredObserver(LocalisationCore::OnRetired observer) { on_retired_ = std::move(observer); }
  // Called where meshes in the map have moved, with the boxes before and after.
  void setMovedObserver(MovingMap::OnMoved observer) { on_moved_ = std::move(observer); }
  // Called with the stage's name when it ends, for a caller that has a clock.
  void setStageObserver(std::function<void(const char* stage)> observer);

  [[nodiscard]] const SE3& T_nav_odom() const { return T_nav_odom_; }
  [[nodiscard]] bool anchored() const { return anchored_; }
  [[nodiscard]] double anchorSigma() const { return anchor_sigma_; }  // of T_nav_odom, horizontal [m]
  // Horizontal standard deviation of a body at that pose, by dead reckoning since the newest keyframe [m];
  // std::nullopt before the first.
  [[nodiscard]] std::optional<double> positionSigma(std::int64_t utc_ns, const SE3& T_odom_body,
                                                    const nav::DeadReckoning::Quality& quality) const;
  [[nodiscard]] const nav::PositionAnchor& anchor() const { return anchor_; }
  [[nodiscard]] const fusion::QuadtreeMap& map() const { return map_.map(); }
  [[nodiscard]] const MovingMap& movingMap() const { return map_; }
  // After load(): whether the slots hold what the state expects; reads all of them.
  [[nodiscard]] bool slotsHold() {
    return map_.slotsHold() && (localisation_ == nullptr || localisation_->slotsHold());
  }
  // The rig's present calibration: the one of the files until matches show another.
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

  // Into one of the same configuration with the same slots: map, poses, lighting model and all counts bit by
  // bit (map_state.cpp). A core is unusable after its load() failed.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  // T_nav_odom by the fixes so far, at `unlocked_s` of odometry without bottom lock [s].
  void anchorAt(double unlocked_s);
  [[nodiscard]] stereo::SeedPlane seedPlane(const MapInput& input) const;
  [[nodiscard]] SE3 poseOf(int keyframe, const SE3& T_odom_cam) const;
  // Gives localisation the frame at its predicted pose; returns its number. `images`: it has usable ones, or
  // features.
  [[nodiscard]] int look(const MapInput& input, const SeenPair& pair, bool images);
  void ended(const char* stage) const {
    if (observer_) observer_(stage);
  }
  // Result of `match` on the pair; matches again if the result changes the rig's calibration.
  template <typename Match>
  const stereo::StereoResult& matchWithRig(const Match& match);
  // Points and triangles of the pair, its local mesh in the camera's frame, and features for localisation.
  const stereo::StereoResult& seeImages(const MapInput& input, const stereo::SeedPlane& plane);
  const stereo::StereoResult& seeFeatures(const MapInput& input);
  void count(const stereo::StereoResult& result);
  // Updates the rig's calibration by a pair's matches and the steps between pairs.
  void updateRig(std::span<const RigMatch> matches, std::int64_t utc_ns);
  // All parts use rig_ from now on, instead of `before`.
  void useRig(const StereoRig& before);
  // Corrects a pair for stereo, by the ranges to its ground or without any.
  void correctPair(const MapInput& input, bool by_range);
  // Fits the ranges to stereo's points, learns the lighting from the pair if it shows new ground, and
  // corrects the left image's colours again.
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
  bool frame_fixed_ = false;  // a pair was mapped: fixes no longer set T_nav_odom directly
  bool anchored_ = false;
  double anchor_sigma_ = 0;  // of T_nav_odom, horizontal [m]
  double last_range_;        // seed where the DVL has no altitude [m]
  std::optional<ColourMatrix> matrix_;
  std::vector<float> point_ranges_;         // of a pair's points; scratch
  std::vector<double> scratch_;             // by point
  std::vector<std::uint8_t> mosaic_, rgb_;  // of one camera after the other, at last the left one's colours
  std::vector<std::uint8_t> left_mono_, right_mono_;
  std::vector<Eigen::Vector3f> points_, right_points_;  // of a pair, for the ranges
  Counters counters_;
};

}  // namespace fathom::onboard
