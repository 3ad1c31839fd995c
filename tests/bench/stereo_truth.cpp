#include "tests/bench/stereo_truth.hpp"

#include "realtime/kernel/input_error.hpp"
#include "sim/scenario/scenario_file.hpp"

namespace fathom::stereo {

TrueMission::TrueMission(const std::filesystem::path& mission)
    : paths_(mission),
      config_(io::readMissionConfig(mission)),
      rig_(readStereoCalib(paths_.calib())),
      scenario_(sim::loadScenario((paths_.truth() / "scenario.toml").string())),
      terrain_(sim::resolvedTerrain(scenario_)),
      features_only_(io::isFeatureMission(paths_)),
      left_ranges_(rig_.left),
      right_ranges_(rig_.right),
      left_light_(rig_.left.width, rig_.left.height, config_.cameras.left_format, config_.cameras.bits, {}),
      right_light_(rig_.right.width, rig_.right.height, config_.cameras.right_format, config_.cameras.bits,
                   {}) {
  const sim::TruthTrack track(paths_.truth());
  for (const sim::TruthTrack::Pair& pair : track.pairs())
    if (const auto pose = track.poseAt(pair.utc_ns))
      names_.push_back({pair.left, pair.right, *pose * scenario_.T_body_cam()});
  if (names_.empty()) throw InputError(paths_.truth().string(), "images.csv", "lists no pair of the survey");
  if (features_only_) return;
  for (const Names& n : names_) {
    left_light_.add(read(n, true).view, rangesOf(n.T_nav_cam, true));
    right_light_.add(read(n, false).view, rangesOf(n.T_nav_cam, false));
  }
}

SeedPlane TrueMission::planeOf(const SE3& T_nav_cam) const {
  constexpr double kNearest = 0.5;  // [m]
  SeedPlane plane;
  const Eigen::Vector3d at = T_nav_cam.translation();
  const double depth = terrain_.depthAt(at.x(), at.y()).value_or(at.z() + plane.distance);
  plane.normal = T_nav_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  plane.distance = std::max(depth - at.z(), kNearest);
  return plane;
}

lighting::RangeLattice TrueMission::rangesOf(const SE3& T_nav_cam, bool left) const {
  const SeedPlane plane = planeOf(T_nav_cam);
  lighting::RangeLattice ranges;
  if (left) {
    left_ranges_.fromPlane(plane.normal, plane.distance, ranges);
  } else {
    const Eigen::Vector3d normal = rig_.T_right_left.rotation() * plane.normal;
    right_ranges_.fromPlane(normal, plane.distance + normal.dot(rig_.T_right_left.translation()), ranges);
  }
  return ranges;
}

io::ImageFile TrueMission::read(const Names& names, bool left) const {
  const Camera& camera = left ? rig_.left : rig_.right;
  return io::readImage(paths_.images() / (left ? names.left : names.right),
                       left ? config_.cameras.left_format : config_.cameras.right_format,
                       config_.cameras.bits, camera.width, camera.height);
}

cv::Mat TrueMission::corrected(const Names& names, bool left) const {
  const io::ImageFile file = read(names, left);
  cv::Mat mosaic(file.view.height, file.view.width, CV_8UC1), mono(mosaic.size(), CV_8UC1);
  (left ? left_light_ : right_light_).correct(file.view, rangesOf(names.T_nav_cam, left), mosaic.data);
  lighting::demosaicMono({mosaic.data, mosaic.cols, mosaic.rows, mosaic.step, file.view.format, 8},
                         mono.data);
  return mono;
}

TruePair TrueMission::pair(std::size_t index) const {
  const Names& names = names_.at(index);
  TruePair pair;
  pair.name = names.left;
  pair.T_nav_cam = names.T_nav_cam;
  pair.plane = planeOf(names.T_nav_cam);
  if (features_only_) {
    io::readFeatureFile(paths_.features() / io::featureFileName(names.left), pair.features);
  } else {
    pair.left = corrected(names, true);
    pair.right = corrected(names, false);
  }
  return pair;
}

std::optional<Eigen::Vector3d> TrueMission::pointAt(const TruePair& pair,
                                                    const Eigen::Vector2d& left_pixel) const {
  const Eigen::Vector3d ray = rig_.left.ray(left_pixel);
  const auto distance = terrain_.castRay(pair.T_nav_cam.translation(), pair.T_nav_cam.rotation() * ray);
  if (!distance) return std::nullopt;
  return ray.normalized() * *distance;
}

}  // namespace fathom::stereo
