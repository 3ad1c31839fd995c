#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "firmware_if/files/feature_file.hpp"
#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/files/mission.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "sim/scenario/scenario.hpp"
#include "sim/score/trajectory_score.hpp"
#include "sim/sea/terrain.hpp"

namespace fathom::stereo {

// One rendered pair with what is known of it.
struct TruePair {
  std::string name;     // of the left image
  cv::Mat left, right;  // 8-bit mono, lighting corrected; empty where the mission has features instead
  StereoFeatureFrame features;
  SE3 T_nav_cam;    // true
  SeedPlane plane;  // level seafloor at the true altitude of the camera
};

// A simulated mission (full truth needed) as a source of such pairs. Moving things are no part of the true
// surface: a point on a fish is an error.
class TrueMission {
 public:
  // Throws InputError for a mission without truth.
  explicit TrueMission(const std::filesystem::path& mission);

  [[nodiscard]] std::size_t pairs() const { return names_.size(); }
  [[nodiscard]] TruePair pair(std::size_t index) const;
  // What a left pixel truly sees, in the left camera frame [m].
  [[nodiscard]] std::optional<Eigen::Vector3d> pointAt(const TruePair& pair,
                                                       const Eigen::Vector2d& left_pixel) const;
  [[nodiscard]] const StereoRig& rig() const { return rig_; }
  [[nodiscard]] bool featuresOnly() const { return features_only_; }

 private:
  struct Names {
    std::string left, right;
    SE3 T_nav_cam;
  };
  [[nodiscard]] SeedPlane planeOf(const SE3& T_nav_cam) const;
  [[nodiscard]] lighting::RangeLattice rangesOf(const SE3& T_nav_cam, bool left) const;
  [[nodiscard]] io::ImageFile read(const Names& names, bool left) const;
  [[nodiscard]] cv::Mat corrected(const Names& names, bool left) const;

  io::MissionPaths paths_;
  io::MissionConfig config_;
  StereoRig rig_;
  sim::Scenario scenario_;
  sim::Terrain terrain_;
  std::vector<Names> names_;
  bool features_only_;
  lighting::RangeMaker left_ranges_, right_ranges_;
  lighting::LightingModel left_light_, right_light_;
};

}  // namespace fathom::stereo
