#pragma once

#include <cmath>
#include <filesystem>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission/feature_file.hpp"
#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/range_lattice.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "sim/scenario/scenario.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "sim/score/trajectory_score.hpp"
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

inline constexpr double kNearest = 0.5;       // that a seafloor is taken to be [m]
inline constexpr double kBeamAngle = 0.5236;  // of a DVL's beams off its axis [rad]: 30 deg

// Depth of the seafloor by the four beams of a DVL [m].
inline std::optional<double> bottomOfDvl(const SE3& T_nav_dvl, const sim::SeaTerrain& terrain) {
  double sum = 0;
  int beams = 0;
  for (int k = 0; k < 4; ++k) {
    const double azimuth = M_PI / 4 + k * M_PI / 2;
    const Eigen::Vector3d beam =
        T_nav_dvl.rotation() * Eigen::Vector3d(std::sin(kBeamAngle) * std::cos(azimuth),
                                               std::sin(kBeamAngle) * std::sin(azimuth),
                                               std::cos(kBeamAngle));
    const auto range = terrain.castRay(T_nav_dvl.translation(), beam);
    if (!range) continue;
    sum += T_nav_dvl.translation().z() + *range * beam.z();
    ++beams;
  }
  if (beams == 0) return std::nullopt;
  return sum / beams;
}

struct TrueMission::Light {
  Light(const StereoRig& rig, const io::MissionConfig::Cameras& cameras)
      : left(rig.left.width, rig.left.height, cameras.left_format, cameras.bits, {}),
        right(rig.right.width, rig.right.height, cameras.right_format, cameras.bits, {}),
        ranges(rig) {}
  lighting::LightingModel left, right;
  lighting::RigRanges ranges;
};

inline TrueMission::TrueMission(const std::filesystem::path& folder)
    : paths_(folder),
      config_(io::readMissionConfig(folder)),
      rig_(readStereoCalib(paths_.calib())),
      images_(paths_, config_, rig_),
      scenario_(sim::loadScenario((paths_.truth() / "scenario.toml").string())),
      terrain_(sim::resolvedTerrain(scenario_)),
      features_only_(io::isFeatureMission(paths_)) {
  const sim::TruthTrack track(paths_.truth());
  for (const sim::TruthTrack::Pair& listed : track.pairs()) {
    const auto T_nav_body = track.poseAt(listed.utc_ns);
    if (!T_nav_body) continue;
    Pair pair{listed.left, listed.right, *T_nav_body * scenario_.T_body_cam(), {}};
    pair.plane.normal = pair.T_nav_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ();
    if (const auto bottom = bottomOfDvl(*T_nav_body * config_.T_body_dvl, terrain_))
      pair.plane.distance = std::max(*bottom - pair.T_nav_cam.translation().z(), kNearest);
    pairs_.push_back(pair);
  }
  if (pairs_.empty()) throw InputError(paths_.truth().string(), "images.csv", "lists no pair of the survey");
}

TrueMission::~TrueMission() = default;

inline io::ImageFile TrueMission::image(std::size_t pair, CameraSide side) const {
  return images_.read(side == CameraSide::kLeft ? pairs_.at(pair).left_name : pairs_.at(pair).right_name,
                      side);
}

inline StereoFeatureFrame TrueMission::features(std::size_t pair) const {
  StereoFeatureFrame frame;
  io::readFeatureFile(paths_.features() / io::featureFileName(pairs_.at(pair).left_name), frame);
  return frame;
}

inline TrueMission::Images TrueMission::corrected(std::size_t pair) const {
  if (!light_) {
    light_ = std::make_unique<Light>(rig_, config_.cameras);
    for (std::size_t k = 0; k < pairs_.size(); ++k) {
      light_->ranges.fromPlane(pairs_[k].plane.normal, pairs_[k].plane.distance);
      light_->left.add(image(k, CameraSide::kLeft).view, light_->ranges.left());
      light_->right.add(image(k, CameraSide::kRight).view, light_->ranges.right());
    }
  }
  const auto grey = [](const io::ImageFile& file, const lighting::LightingModel& light,
                       const lighting::RangeLattice& ranges) {
    cv::Mat mosaic(file.view.height, file.view.width, CV_8UC1), rgb(mosaic.size(), CV_8UC3),
        mono(mosaic.size(), CV_8UC1);
    light.grey(file.view, ranges, mosaic.data, rgb.data, mono.data);
    return mono;
  };
  light_->ranges.fromPlane(pairs_.at(pair).plane.normal, pairs_[pair].plane.distance);
  return {grey(image(pair, CameraSide::kLeft), light_->left, light_->ranges.left()),
          grey(image(pair, CameraSide::kRight), light_->right, light_->ranges.right())};
}

inline std::optional<Eigen::Vector3d> TrueMission::pointAt(std::size_t pair,
                                                           const Eigen::Vector2d& pixel) const {
  const SE3& T_nav_cam = pairs_.at(pair).T_nav_cam;
  const Eigen::Vector3d ray = rig_.left.ray(pixel);
  const auto distance = terrain_.castRay(T_nav_cam.translation(), T_nav_cam.rotation() * ray);
  if (!distance) return std::nullopt;
  return ray.normalized() * *distance;
}

}  // namespace fathom::bench
