#include "recon/topside/input/seed_plane.hpp"

namespace fathom::topside {
namespace {

constexpr double kLooksAhead = 0.3;  // cosine of the principal ray from the vertical, below

}  // namespace

stereo::SeedPlane seedPlane(const io::MissionConfig& mission, const SE3& T_nav_body, double altitude) {
  const SE3 T_nav_cam = T_nav_body * mission.T_body_cam;
  const double bottom = (T_nav_body * mission.T_body_dvl.translation()).z() + altitude;
  stereo::SeedPlane plane;
  plane.normal = T_nav_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  plane.distance = bottom - T_nav_cam.translation().z();
  return plane;
}

SeedPlanes seedPlanes(const io::MissionConfig& mission, const std::vector<NavigatedPose>& poses,
                      double default_altitude) {
  SeedPlanes planes;
  double altitude = default_altitude;
  for (const NavigatedPose& pose : poses) {
    if (pose.altitude) altitude = *pose.altitude;
    planes.emplace_back();
    if (!pose.T_nav_body) continue;
    planes.back() = seedPlane(mission, *pose.T_nav_body, altitude);
    if (planes.back()->normal.z() < kLooksAhead)
      planes.back() = stereo::SeedPlane{Eigen::Vector3d::UnitZ(), default_altitude};
  }
  return planes;
}

}  // namespace fathom::topside
