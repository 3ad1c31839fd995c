#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "recon/fusion/quadtree_map.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/rig_ranges.hpp"
#include "recon/nav/position_anchor.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::onboard {

struct MapCoreConfig {
  StereoRig rig;
  SE3 T_body_cam, T_body_dvl;
  PixelFormat left_format = PixelFormat::kBayerRggb;
  PixelFormat right_format = PixelFormat::kMono;
  int bits = 12;
  stereo::SparseStereoConfig stereo;
  lighting::LightingConfig lighting;
  fusion::QuadtreeConfig map;
};

// One stereo pair with the odometry of its exposure.
struct MapInput {
  std::uint32_t pair_index = 0;
  std::int64_t utc_ns = 0;
  SE3 T_odom_body;
  std::optional<double> altitude;  // of the DVL above the seafloor [m]
  ImageView left, right;           // raw, as the cameras gave them
  int max_features = 0;            // this frame's work quota; <= 0: as configured
};

// What one pair gave.
struct MapOutput {
  std::uint32_t pair_index = 0;
  std::int64_t utc_ns = 0;
  SE3 T_nav_cam;
  double median_range = 0;      // of the stereo points along z of the camera; 0 without points [m]
  double footprint_radius = 0;  // of the local mesh about its centre, in plan [m]
  Eigen::Vector2d min_north_east = Eigen::Vector2d::Zero();  // of the local mesh [m]
  Eigen::Vector2d max_north_east = Eigen::Vector2d::Zero();
  std::size_t points = 0, triangles = 0, nodes_updated = 0;
};

// Soft real-time core without threads, files or clocks: lighting, stereo and fusion of each pair into the
// onboard map. Owns the position fixes and T_nav_odom: the shift is held fixed from the first mapped pair on,
// so that the map never tears; before, and without any fix, nav and odom coincide and anchored() is false.
class MapCore {
 public:
  explicit MapCore(const MapCoreConfig& config);

  // A fix as nav::PositionAnchor takes it: `difference` is nav - odom of the antenna or transponder [m].
  void addFix(nav::FixKind kind, const Eigen::Vector2d& difference, double sigma) noexcept;
  MapOutput process(const MapInput& input);

  [[nodiscard]] const SE3& T_nav_odom() const { return T_nav_odom_; }
  [[nodiscard]] bool anchored() const { return anchored_; }
  [[nodiscard]] double anchorSigma() const { return anchor_sigma_; }  // of T_nav_odom, horizontal [m]
  [[nodiscard]] const nav::PositionAnchor& anchor() const { return anchor_; }
  [[nodiscard]] const fusion::QuadtreeMap& map() const { return map_; }

  struct Counters {
    std::uint64_t pairs = 0, pairs_without_points = 0, bad_images = 0, points = 0;
    stereo::StereoResult::Rejected rejected;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const lighting::LightingModel& leftLight() const { return left_light_; }
  [[nodiscard]] const lighting::LightingModel& rightLight() const { return right_light_; }

 private:
  [[nodiscard]] stereo::SeedPlane seedPlane(const MapInput& input) const;
  // Corrects a pair for stereo.
  void correctPair(const MapInput& input);
  // Bends the ranges to stereo's points, learns the pair by them and corrects the left image's colours anew.
  void learnLight(const MapInput& input, const stereo::StereoResult& result);

  MapCoreConfig config_;
  lighting::LightingModel left_light_, right_light_;
  lighting::RigRanges ranges_;
  stereo::SparseStereo stereo_;
  fusion::QuadtreeMap map_;
  nav::PositionAnchor anchor_;
  SE3 T_nav_odom_;
  bool frame_fixed_ = false;
  bool anchored_ = false;
  double anchor_sigma_ = 0;  // of T_nav_odom, horizontal [m]
  double last_range_;        // seed where the DVL has no altitude [m]
  std::vector<std::uint8_t> left_mosaic_, left_mono_, left_rgb_, right_mosaic_, right_mono_;
  std::vector<Eigen::Vector3f> points_, right_points_;  // of a pair, for the ranges
  Counters counters_;
};

}  // namespace fathom::onboard
