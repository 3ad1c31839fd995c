#include "recon/topside/input/seed_plane.hpp"

namespace fathom::topside {

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
    if (pose.T_nav_body) planes.back() = seedPlane(mission, *pose.T_nav_body, altitude);
  }
  return planes;
}

}  // namespace fathom::topside
