#pragma once

#include <filesystem>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission/feature_file.hpp"
#include "firmware_if/mission/images/mission_images.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "sim/scenario/scenario.hpp"
#include "sim/sea/sea_terrain.hpp"

namespace fathom::bench {

[[nodiscard]] inline ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, image.step, PixelFormat::kMono, 8};
}

// A simulated mission with its truth (all of it is needed): images, true poses of the left camera, the true
// seafloor. Moving things are no part of that: a point on a fish is an error.
class TrueMission {
 public:
  // Throws InputError for a mission without truth.
  explicit TrueMission(const std::filesystem::path& folder);
  ~TrueMission();
  TrueMission(const TrueMission&) = delete;
  TrueMission& operator=(const TrueMission&) = delete;

  struct Pair {
    std::string left_name, right_name;
    SE3 T_nav_cam;            // of the left camera, true
    stereo::SeedPlane plane;  // level, at the depth that a DVL's four beams would give
  };
  [[nodiscard]] const std::vector<Pair>& pairs() const { return pairs_; }
  [[nodiscard]] const StereoRig& rig() const { return rig_; }
  [[nodiscard]] bool featuresOnly() const { return features_only_; }
  [[nodiscard]] io::ImageFile image(std::size_t pair, CameraSide side) const;
  [[nodiscard]] StereoFeatureFrame features(std::size_t pair) const;

  // Both images in 8-bit grey, lighting corrected by models of all images of the mission, which the first
  // call learns.
  struct Images {
    cv::Mat left, right;
  };
  [[nodiscard]] Images corrected(std::size_t pair) const;

  // The true point of a distorted left pixel, in the left camera's frame [m]; nothing beside the seafloor.
  [[nodiscard]] std::optional<Eigen::Vector3d> pointAt(std::size_t pair, const Eigen::Vector2d& pixel) const;

 private:
  struct Light;

  io::MissionPaths paths_;
  io::MissionConfig config_;
  StereoRig rig_;
  io::MissionImages images_;
  sim::Scenario scenario_;
  sim::SeaTerrain terrain_;
  bool features_only_;
  std::vector<Pair> pairs_;
  mutable std::unique_ptr<Light> light_;
};

}  // namespace fathom::bench
