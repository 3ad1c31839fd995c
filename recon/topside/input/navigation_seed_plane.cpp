#include "recon/topside/input/navigation_seed_plane.hpp"

namespace fathom::topside {
namespace {}  // namespace

stereo::SeedPlane seedPlane(const io::MissionConfig& mission, const SE3& T_nav_body, double altitude) {
  // Of the attitude alone, bit by bit: a pose that moved leaves what was made of its images as it was.
  const Eigen::Matrix3d R_nav_body = T_nav_body.matrix3();
  stereo::SeedPlane plane;
  plane.normal = (R_nav_body * mission.T_body_cam.matrix3()).transpose() * Eigen::Vector3d::UnitZ();
  plane.distance =
      altitude + (R_nav_body * (mission.T_body_dvl.translation() - mission.T_body_cam.translation())).z();
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
