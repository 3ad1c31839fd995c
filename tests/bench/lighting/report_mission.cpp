#include "tests/bench/lighting/report_mission.hpp"

#include <cmath>

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "sim/score/trajectory_score.hpp"

namespace fathom::bench {
namespace {

constexpr double kBeamAngle = 0.5236;  // of a DVL's beams off its axis [rad]: 30 deg
constexpr double kHidden = 0.02;       // a point is seen if nothing is so much nearer [m]

}  // namespace

ReportMission::ReportMission(const std::filesystem::path& folder)
    : paths_(folder),
      config_(io::readMissionConfig(folder)),
      rig_(readStereoCalib(paths_.calib())),
      surface_(readPly(paths_.truth() / "terrain.ply")) {
  const sim::TruthTrack track(paths_.truth());
  for (const sim::TruthTrack::Pair& listed : track.pairs()) {
    const auto T_nav_body = track.poseAt(listed.utc_ns);
    if (!T_nav_body) continue;
    double sum = 0;
    int beams = 0;
    for (int k = 0; k < 4; ++k) {
      const double azimuth = M_PI / 4 + k * M_PI / 2;
      const Eigen::Vector3d beam(std::sin(kBeamAngle) * std::cos(azimuth),
                                 std::sin(kBeamAngle) * std::sin(azimuth), std::cos(kBeamAngle));
      const SE3 T_nav_dvl = *T_nav_body * config_.T_body_dvl;
      const auto hit = surface_.castRay(T_nav_dvl.translation(), T_nav_dvl.rotation() * beam);
      if (!hit) continue;
      sum += hit->z() - T_nav_dvl.translation().z();
      ++beams;
    }
    if (beams == 0) continue;
    Pair pair{listed.left, listed.right, *T_nav_body * config_.T_body_cam, {}};
    const double bottom = (*T_nav_body * config_.T_body_dvl.translation()).z() + sum / beams;
    pair.plane = {pair.T_nav_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ(),
                  bottom - pair.T_nav_cam.translation().z()};
    pairs_.push_back(pair);
  }
  if (pairs_.empty()) throw InputError((paths_.truth() / "images.csv").string(), "", "lists no pair");
}

io::ImageFile ReportMission::left(std::size_t pair) const {
  return io::readImage(paths_.images() / pairs_[pair].left_name, config_.cameras.left_format,
                       config_.cameras.bits, rig_.left.width, rig_.left.height);
}

io::ImageFile ReportMission::right(std::size_t pair) const {
  return io::readImage(paths_.images() / pairs_[pair].right_name, config_.cameras.right_format,
                       config_.cameras.bits, rig_.right.width, rig_.right.height);
}

std::optional<Eigen::Vector3d> ReportMission::seafloorAt(std::size_t pair,
                                                         const Eigen::Vector2d& pixel) const {
  const SE3& T_nav_cam = pairs_[pair].T_nav_cam;
  return surface_.castRay(T_nav_cam.translation(), T_nav_cam.rotation() * rig_.left.ray(pixel));
}

std::optional<Eigen::Vector2d> ReportMission::pixelOf(std::size_t pair, const Eigen::Vector3d& point) const {
  const SE3& T_nav_cam = pairs_[pair].T_nav_cam;
  const Eigen::Vector3d in_camera = T_nav_cam.inverse() * point;
  if (in_camera.z() <= 0.1) return std::nullopt;
  // Beyond the image the distortion's polynomial folds back: ask first whether the pixel's ray leads there.
  const Eigen::Vector2d pixel = rig_.left.project(in_camera);
  if (!rig_.left.contains(pixel)) return std::nullopt;
  const Eigen::Vector3d ray = rig_.left.ray(pixel);
  if ((ray.head<2>() - in_camera.head<2>() / in_camera.z()).norm() > 1e-3) return std::nullopt;
  const auto seen = surface_.castRay(T_nav_cam.translation(), T_nav_cam.rotation() * ray);
  if (!seen || (*seen - point).norm() > kHidden) return std::nullopt;
  return pixel;
}

}  // namespace fathom::bench
